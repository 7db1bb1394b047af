"""The link quality of a run: how well it kept its rate, and how many answers came in time.

    link = LinkMonitor(pace, driver.counters)       # from here on
    ...                                             # steps of `pace`, answers of `driver`
    link.statistics().as_dict()                     # for the run's JSON
    print(link.statistics())                        # one line

As in ros2_control a period is the time from the beginning of one control step to that of the next,
and an overrun is a step that ended after the deadline of the next. Of each servo are counted the
answers that were asked for; those that did not come in time, or damaged (lost); those that came,
but by more than `bus_client.LATE` later than the wire explains (late); and those that came, but
were of an earlier question (stale).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, Self

import numpy as np

from hardware.counters import Counters
from hardware.pace import FixedRate

PERCENTILES = (50, 90, 99)  # of the periods
EVERY = 5.0  # s between the lines of a run


class LinkScore(NamedTuple):
    """Whether a link may drive a robot, and why.

    The score is what is left of the limit that is used most: 1 is a perfect link, below 0 means
    no-go.
    """

    value: float
    reason: str

    @property
    def go(self) -> bool:
        """Whether the robot may be armed."""
        return self.value >= 0

    def as_dict(self) -> dict[str, Any]:
        """Return the entry of a run's JSON."""
        return {"score": self.value, "go": self.go, "reason": self.reason}

    def __str__(self) -> str:
        return f"link score {self.value:.2f}: {'go' if self.go else 'no-go'}; {self.reason}"


@dataclass(frozen=True)
class AnswerCounts:
    """Counts of one servo's answers: asked for, lost, late and stale."""

    asked: int = 0
    lost: int = 0
    late: int = 0
    stale: int = 0

    def __add__(self, other: Self) -> AnswerCounts:
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return AnswerCounts(*(one + two for one, two in pairs))

    def fraction(self, kind: str) -> float:
        """Return which part of what was asked for was "lost", "late" or "stale"."""
        return getattr(self, kind) / max(self.asked, 1)


@dataclass(frozen=True)
class LinkStatistics:
    """Periods, overruns and answers of a run."""

    periods: np.ndarray  # from the beginning of each step to that of the next [s], (T - 1,)
    overruns: int  # steps that ended after the deadline of the next
    servos: Mapping[str, AnswerCounts]  # what became of the answers, by servo
    # of the link before the robot was armed; None where none was measured
    score: LinkScore | None = None

    def __add__(self, other: Self) -> LinkStatistics:
        """Return the statistics of two runs of one robot together."""
        servos = {name: counts + other.servos[name] for name, counts in self.servos.items()}
        periods = np.concatenate([self.periods, other.periods])
        overruns = self.overruns + other.overruns
        return LinkStatistics(periods, overruns, servos, self.score)

    @property
    def percentiles(self) -> dict[str, float]:
        """The periods' 50th, 90th and 99th percentiles [s], by "p50" and so on; {} of none."""
        if not len(self.periods):
            return {}
        values = np.percentile(self.periods, PERCENTILES)
        return {f"p{p}": float(value) for p, value in zip(PERCENTILES, values, strict=True)}

    @property
    def total(self) -> AnswerCounts:
        """Counts of the answers of all servos together."""
        return sum(self.servos.values(), AnswerCounts())

    def worst(self, kind: str) -> tuple[str, float]:
        """Return the servo of whose answers the largest part was `kind`, and that part."""
        parts = {name: counts.fraction(kind) for name, counts in self.servos.items()}
        name = max(parts, key=lambda name: parts[name])
        return name, parts[name]

    def as_dict(self) -> dict[str, Any]:
        """Return the entry of a run's JSON: counts, and periods in seconds."""
        servos = {name: dict(vars(counts)) for name, counts in self.servos.items()}
        return {
            "periods": len(self.periods),
            "period": self.percentiles,
            "overruns": self.overruns,
            "servos": servos,
            "score": None if self.score is None else self.score.as_dict(),
        }

    def __str__(self) -> str:
        return format_link(self.as_dict())


def format_link(link: Mapping[str, Any]) -> str:
    """Format the link quality in a run's JSON as one line."""
    percentiles, servos = link["period"], link["servos"]
    spread = "/".join(f"{1e3 * percentiles.get(f'p{p}', math.nan):.1f}" for p in PERCENTILES)
    total = sum((AnswerCounts(**counts) for counts in servos.values()), AnswerCounts())
    line = (
        f"link: period {spread} ms (p50/p90/p99), {link['overruns']} overruns in "
        f"{link['periods']} periods; of {total.asked} answers {total.lost} lost, "
        f"{total.late} late, {total.stale} stale"
    )
    bad = {name: c["lost"] + c["late"] + c["stale"] for name, c in servos.items()}
    worst = max(bad, key=lambda name: bad[name])
    return f"{line}, most of them {worst}'s" if len(servos) > 1 and bad[worst] else line


class LinkMonitor:
    """Statistics of the link since the construction of this object.

    Args:
        pace: the deadlines of the run's steps.
        counters: counters of each servo, updated by the driver.
        score: link score before the robot was armed.
    """

    def __init__(
        self, pace: FixedRate, counters: Mapping[str, Counters], score: LinkScore | None = None
    ) -> None:
        self._pace, self._first, self._overruns = pace, len(pace.starts), pace.overruns
        self._score = score
        self._counters = counters
        self._before = {name: replace(count) for name, count in counters.items()}
        self._reported: float | None = None

    def statistics(self) -> LinkStatistics:
        """Return the statistics until now."""
        kinds = fields(AnswerCounts)
        servos = {
            name: AnswerCounts(*(getattr(now, f.name) - getattr(before, f.name) for f in kinds))
            for (name, before), now in zip(
                self._before.items(), self._counters.values(), strict=True
            )
        }
        periods = np.diff(self._pace.starts[self._first :])
        overruns = self._pace.overruns - self._overruns
        return LinkStatistics(periods, overruns, servos, self._score)

    def __str__(self) -> str:
        return str(self.statistics())

    def is_due(self, now: float) -> bool:
        """Say whether a line of the run is due: every EVERY seconds.

        Args:
            now: the time [s].
        """
        if self._reported is None:
            self._reported = now
        if now - self._reported < EVERY:
            return False
        self._reported = now
        return True
