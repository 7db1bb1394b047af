"""Whatever ends the program, the robot's torque goes off first.

    with Ending(guard.stop):
        ...             # Ctrl-C, kill, a closed terminal, an exception, the interpreter's end

Of Python's garbage collector nothing is heard meanwhile but for what is made meanwhile: looking
through a whole program takes longer than a control step.
"""

from __future__ import annotations

import atexit
import gc
import signal
import threading
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any, Self

# Ctrl-C, kill, a terminal or SSH session that closes, Ctrl-\\; Windows lacks the last two
SIGNALS = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
    if hasattr(signal, name)
]
OF_THE_TERMINAL = SIGNALS[2:]  # under nohup a program outlives its terminal


class Ending:
    """Calls a function when the block ends, and before any signal ends the program.

    Args:
        stop: what to call; it may be called several times.
    """

    def __init__(self, stop: Callable[[], None]) -> None:
        self._stop = stop
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in SIGNALS:
                ignored = signal.getsignal(number) == signal.SIG_IGN
                if not (ignored and number in OF_THE_TERMINAL):
                    self._before[number] = signal.signal(number, self._on_signal)
        atexit.register(self._stop)
        gc.collect()
        gc.freeze()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self._stop()
        finally:
            gc.unfreeze()
            atexit.unregister(self._stop)
            for number, handler in self._before.items():
                signal.signal(number, handler)
            self._before.clear()

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        """Stop first, then do what the signal usually does; a second one does not break in."""
        for each in self._before:
            signal.signal(each, signal.SIG_IGN)
        self._stop()
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        raise SystemExit(128 + number)
