"""Whatever ends the program, the robot's torque goes off first.

    ending = ShutdownHook(guard.stop)
    with ending:
        ...             # Ctrl-C, kill, a closed terminal, an exception, the interpreter's end
        with ending.held():
            ...         # a torque-off: a signal is noted, and ends the program afterwards

Of Python's garbage collector nothing is heard meanwhile but for what is made meanwhile: looking
through a whole program takes longer than a control step.
"""

import atexit
import gc
import logging
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

# Ctrl-C, kill, a terminal or SSH session that closes, Ctrl-\\; Windows lacks the last two
SIGNALS = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
    if hasattr(signal, name)
]
OF_THE_TERMINAL = SIGNALS[2:]  # under nohup a program outlives its terminal
_logger = logging.getLogger(__name__)


class ShutdownHook:
    """Calls a function when the block ends, and before any signal ends the program.

    Args:
        stop: what to call; it may be called several times.
    """

    def __init__(self, stop: Callable[[], None]) -> None:
        self._stop = stop
        self._before: dict[int, Any] = {}
        self._depth = 0  # of blocks that no signal breaks
        self._noted: int | None = None  # the first signal
        self._acted = False  # it has ended the program

    def __enter__(self) -> Self:
        self._noted, self._acted = None, False
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                ignored = signal.getsignal(number) == signal.SIG_IGN
                if not (ignored and number in OF_THE_TERMINAL):
                    self._before[number] = signal.signal(number, self._on_signal)
        atexit.register(self._stop)
        gc.freeze()
        return self

    def __exit__(self, *error: object) -> None:
        try:
            self._stop()
        finally:
            gc.unfreeze()
            atexit.unregister(self._stop)
            for number, handler in self._before.items():
                signal.signal(number, handler)
            self._before.clear()
        if error[1] is None:
            self._act()

    @contextmanager
    def held(self) -> Iterator[None]:
        """Finish this block whatever signals come, then do what the first of them usually does.

        An error that leaves the block goes first: it may say that a servo is still powered.
        """
        self._depth += 1
        try:
            yield
        finally:
            self._depth -= 1
        self._act()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        """Stop first, then do what the signal usually does; a second one does not break in."""
        if self._acted:
            return
        self._noted = self._noted or number
        if self._depth:
            _logger.warning("%s: torque goes off first", signal.Signals(number).name)
            return
        with self.held():
            self._stop()

    def _act(self) -> None:
        """Raise what a noted signal raises, once."""
        if self._depth or self._acted or self._noted is None:
            return
        self._acted = True
        if self._noted == signal.SIGINT:
            raise KeyboardInterrupt
        raise SystemExit(128 + self._noted)
