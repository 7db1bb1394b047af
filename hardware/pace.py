"""A fixed rate: absolute deadlines, no drift, and no burst to catch up after a late step.

    pace = FixedRate(clock, rate=50.0)
    while running:
        pace.wait()                 # until the next deadline
        ...

Afterwards `pace.missed`, `pace.overruns`, `pace.starts` and `pace.jitter` say how well it went.
"""

import math

from hardware.clock import Clock

ROUNDING = 1e-9  # s, of a sum of periods


class FixedRate:
    """Deadlines every 1 / rate seconds from the first `wait` on.

    A step that is late by whole periods loses their deadlines: they are counted, not made up for.

    Args:
        clock: source of the time.
        rate: steps a second.
    """

    def __init__(self, clock: Clock, rate: float) -> None:
        self.period = 1 / rate
        self.missed = 0
        self.overruns = 0  # steps that ended after the next one's deadline
        self.starts: list[float] = []  # s, when each step began
        self.jitter: list[float] = []  # s that each step began after its deadline
        self._clock = clock
        self._start: float | None = None
        self._steps = 0

    def wait(self, latest: float = math.inf) -> float:
        """Wait for the next deadline and return it [s].

        Args:
            latest: how long after its deadline a step may begin [s]; later it waits for the next.
        """
        deadline = self._next()
        self.overruns += self._clock.now() > deadline + ROUNDING
        self._clock.sleep_until(deadline)
        if self._clock.now() - deadline > latest:
            deadline = self._next()
            self._clock.sleep_until(deadline)
        self.starts.append(self._clock.now())
        self.jitter.append(self.starts[-1] - deadline)
        return deadline

    def _next(self) -> float:
        """Return the next deadline [s], and count those that have passed by whole periods."""
        now = self._clock.now()
        if self._start is None:
            self._start = now
        else:
            self._steps += 1
            behind = int((now - self._start) / self.period + ROUNDING) - self._steps
            if behind > 0:
                self.missed += behind
                self._steps += behind
        return self._start + self._steps * self.period
