"""Time as the driver sees it: the machine's, or one that only waiting moves."""

import os
import select
import time
from typing import Any, Protocol


class Clock(Protocol):
    """A clock that never runs back; `jitter` [s] is how late it may wake who waits on it."""

    jitter: float

    def now(self) -> float:
        """Return the time [s] from some fixed moment."""
        ...

    def sleep_until(self, moment: float) -> None:
        """Wait until the time is `moment` [s]; return at once if it has passed."""
        ...

    def wait_for_bytes(self, port: Any, moment: float) -> None:
        """Wait until this serial port has bytes to read, but no longer than until `moment` [s]."""
        ...


class RealClock:
    """The machine's monotonic clock; setting the date does not touch it."""

    jitter = 0.01

    def now(self) -> float:
        """Return the time [s]."""
        return time.perf_counter()

    def sleep_until(self, moment: float) -> None:
        """Wait until the time is `moment` [s]."""
        left = moment - self.now()
        if left > 0:
            time.sleep(left)

    def wait_for_bytes(self, port: Any, moment: float) -> None:
        """Sleep until bytes come or the time is `moment` [s]; where no port can wake us, 50 us."""
        if os.name == "posix":
            select.select([port], [], [], max(moment - self.now(), 0.0))
        else:
            time.sleep(5e-5)


class VirtualClock:
    """A clock that stands still but for those who wait on it.

    Args:
        start: the time that it shows at first [s].
    """

    jitter = 0.002

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """Return the time [s]."""
        return self._now

    def sleep_until(self, moment: float) -> None:
        """Go on to `moment` [s]."""
        self._now = max(self._now, moment)

    def wait_for_bytes(self, port: Any, moment: float) -> None:
        """Do nothing: reading from the emulated port moves the clock."""
