"""What the seeds conclude, decided with our figures.

    decide({"left": "after", "is": "above", "right": "nav2d_gradient.after"}, row, measures, "mean")

A claim says that one measure is above or below another, or a number, by at least `by`; the right
side may be scaled by `times`. It holds where the whole interval of the difference says so, is
contradicted where the whole interval says the opposite, and is undecided between. With `paired`
runs of one seed are compared with each other. A verdict over fewer than five runs says so: their
intervals are known to be too narrow. An undecided claim says how many runs would decide it.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.cases import DRAWS, over_runs
from benchmarks.seeds.figures import STATISTICS, Found
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.statistics import FEW, Interval, difference
from sim2real.runs.tables import format_cell

KEYS = {"claim", "left", "is", "right", "by", "times", "paired"}
MANY = 100  # runs above which a difference is as good as none, and their number a guess


@dataclass(frozen=True)
class Verdict:
    """An answer to a claim."""

    claim: str  # in words
    answer: str  # holds, contradicted, undecided, or "not run"
    # by how much left is on its side of right, with its interval over runs; None where nothing
    # can be compared
    by: Interval | float | None = None
    runs: int = FEW  # of the side with fewer of them

    @property
    def needed(self) -> float:
        """Runs a side that would decide the claim if its margin and their spread stayed as found.

        The distance of an interval's bound from its value shrinks with the square root of the
        number of runs. At least `FEW`, below which no interval is trusted.
        """
        if not isinstance(self.by, Interval):
            return FEW
        value, low, high = self.by
        reach = value - low if value > 0 else high - value
        return max(FEW, math.ceil(self.runs * (reach / value) ** 2)) if value else math.inf

    def __str__(self) -> str:
        """Say it in one line."""
        if self.by is None:
            return f"{self.answer}: {self.claim}"
        few = ", few runs" if self.runs < FEW else ""
        said = f"{self.answer}{few}: {self.claim} ({format_cell(self.by)})"
        return f"{said}; needs {_many(self.needed)} runs" if self.answer == "undecided" else said


def _many(runs: float) -> str:
    """Return a number of runs as far as it can be known."""
    return f"over {MANY}" if runs > MANY else f"{runs:.0f}"


def decide(
    claim: Mapping[str, Any], row: str, measures: Mapping[str, Found], statistic: str
) -> Verdict:
    """Decide a claim of a row.

    Args:
        claim: see the module's text.
        row: its id; a measure that names no row is its own.
        measures: all measures, by `row.measure`.
        statistic: of several runs, "mean" or "iqm".

    Raises:
        Sim2RealError: a claim with another key, relation or measure than there are.
    """
    if (unknown := sorted(set(claim) - KEYS)) or claim["is"] not in ("above", "below"):
        raise Sim2RealError(f"rows.yaml, {row}: {unknown or claim['is']} in a claim is unknown")
    sign = 1.0 if claim["is"] == "above" else -1.0
    left = _side(claim["left"], row, measures)
    right = _side(claim["right"], row, measures)
    if not left.values or not right.values:
        return Verdict(claim["claim"], "not run")
    by, times = float(claim.get("by", 0.0)), float(claim.get("times", 1.0))
    first, second = sign * left.column - by, sign * times * right.column
    found = _difference(first, second, left, right, claim, statistic)
    runs = min(len(side.values) for side in (left, right) if "" not in side.values)
    if not isinstance(found, Interval):
        return Verdict(claim["claim"], "undecided", found, runs)
    answer = "undecided"
    if found.excludes(0.0):
        answer = "holds" if found.value > 0 else "contradicted"
    return Verdict(claim["claim"], answer, found, runs)


def _side(side: str | float, row: str, measures: Mapping[str, Found]) -> Found:
    """Return a measure's figures, or a number as those of no run in particular."""
    if not isinstance(side, str):
        return Found({"": float(side)})
    name = side if side in measures else f"{row}.{side}"
    if name not in measures:
        raise Sim2RealError(f"rows.yaml, {row}: there is no measure {name}")
    return measures[name]


def _difference(
    first: np.ndarray,
    second: np.ndarray,
    left: Found,
    right: Found,
    claim: Mapping[str, Any],
    statistic: str,
) -> Interval | float | None:
    """Compare columns (n, 1) and (m, 1); a plain number where there are too few for an interval."""
    rng, take = np.random.default_rng(0), STATISTICS[statistic]
    single = "" in right.values
    if claim.get("paired") and set(left.values) == set(right.values):
        single, second, first = True, np.zeros((1, 1)), first - second
    if single:
        return over_runs((first - second)[:, 0], take)
    if min(len(first), len(second)) < 2:
        return float(take(first) - take(second))
    return difference(first, second, take, rng, draws=DRAWS)
