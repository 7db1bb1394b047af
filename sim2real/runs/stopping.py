"""Ending a run from outside: Ctrl-C and SIGTERM ask once, Ctrl-C again insists.

with GracefulStop() as stopping:
    while work and not stopping.signal:
        iterate()
"""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from types import FrameType
from typing import Any

log = logging.getLogger(__name__)
SIGNALS = (signal.SIGINT, signal.SIGTERM)


class GracefulStop:
    """Notes the first signal, so that the iteration in progress can finish; a second interrupts it.

    Outside the main thread, where Python delivers no signals, it does nothing.

    Attributes:
        signal: number of the signal that came, or 0.
    """

    def __init__(self) -> None:
        self.signal = 0
        self._before: dict[int, Any] = {}

    def __enter__(self) -> GracefulStop:
        """Take over the signals."""
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._note) for number in SIGNALS}
        return self

    def __exit__(self, *error: object) -> None:
        """Give the signals back."""
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.signal:
            raise KeyboardInterrupt
        self.signal = number
        log.warning("stopping after the iteration in progress; press Ctrl-C again to abandon it")


@contextmanager
def holding_interrupts() -> Iterator[None]:
    """Hold Ctrl-C back until the end; processes that are started meanwhile never get it.

    Else it reaches them while they import, and each writes a traceback.
    """
    resource_tracker.ensure_running()  # which lets Ctrl-C through again as it starts
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def spare_children() -> None:
    """Let Ctrl-C from now on reach this process alone, and none that it starts.

    Signals that a thread blocks are blocked in its children. Another thread takes this one, and
    Python runs its handler in the main thread all the same ("signal", on threads).
    """
    resource_tracker.ensure_running()  # which lets Ctrl-C through again as it starts
    threading.Thread(target=threading.Event().wait, name="takes Ctrl-C", daemon=True).start()
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
