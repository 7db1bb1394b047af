"""A fixed rate: absolute deadlines, no drift, and no burst to catch up after a late step.

    pace = FixedRate(clock, rate=50.0)
    while running:
        pace.wait()                 # until the next deadline
        ...

Afterwards `pace.missed` and `pace.jitter` say how well it went.
"""

from __future__ import annotations

from hardware.clock import Clock


class FixedRate:
    """Deadlines every 1 / rate seconds from the first `wait` on.

    A step that is late by whole periods loses their deadlines: they are counted, not made up for.

    Args:
        clock: the time.
        rate: steps a second.
    """

    def __init__(self, clock: Clock, rate: float) -> None:
        self.period = 1 / rate
        self.missed = 0
        self.jitter: list[float] = []  # s that each step began after its deadline
        self._clock = clock
        self._start: float | None = None
        self._steps = 0

    def wait(self) -> float:
        """Wait for the next deadline and return it [s]."""
        now = self._clock.now()
        if self._start is None:
            self._start = now
        else:
            self._steps += 1
            behind = int((now - self._start) / self.period + 1e-9) - self._steps
            if behind > 0:
                self.missed += behind
                self._steps += behind
        deadline = self._start + self._steps * self.period
        self._clock.sleep_until(deadline)
        self.jitter.append(self._clock.now() - deadline)
        return deadline
