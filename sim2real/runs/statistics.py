"""Statistics of few, expensive runs: robust means, intervals, probability of improvement.

    scores = np.array([[1.0, 2.0], [1.5, 2.5], [0.5, 3.0]])      # (n runs, C tasks or grid cells)
    bootstrap(scores, iqm, rng, draws=2000, resample="rows")     # Interval(value, low, high)

What is resampled decides what the interval speaks about, so `resample` has no default:

* "rows": whole runs. Use it where the columns of a run belong together, as the cells of a grid
  under one trained policy do: resampling cells would count correlated numbers as independent.
* "within_columns": runs within each column by themselves (the stratified bootstrap of Agarwal et
  al. 2021). Use it where each (run, task) was trained, or each (repeat, cell) was evaluated,
  independently.

A statistic takes values (..., n, C) and reduces the last two axes.
"""

from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from scipy import stats

from sim2real.runs.errors import Sim2RealError

Statistic = Callable[[np.ndarray], np.ndarray]
Resample = Literal["rows", "within_columns"]
FEW = 5  # runs below which a bootstrap interval is known to be too narrow


class StatsError(Sim2RealError):
    """Numbers that do not support the statistic that was asked for."""


class Interval(NamedTuple):
    """An estimate and its confidence interval."""

    value: float
    low: float
    high: float

    def excludes(self, value: float) -> bool:
        """Return whether the whole interval lies on one side of a value."""
        return self.low > value or self.high < value


def iqm(values: np.ndarray) -> np.ndarray:
    """Return the interquartile mean, that of the middle half, of values (..., n, C)."""
    values = np.asarray(values, dtype=np.float64)
    return stats.trim_mean(values.reshape(*values.shape[:-2], -1), 0.25, axis=-1)


def mean(values: np.ndarray) -> np.ndarray:
    """Return the mean over the last two axes of values (..., n, C)."""
    return np.asarray(values, dtype=np.float64).mean(axis=(-2, -1))


def median(values: np.ndarray) -> np.ndarray:
    """Return the median over the last two axes of values (..., n, C)."""
    return np.median(values, axis=(-2, -1))


def fraction_above(threshold: float) -> Statistic:
    """Return the statistic that is the share of values above a threshold."""
    return lambda values: (np.asarray(values) > threshold).mean(axis=(-2, -1))


def bootstrap(
    values: np.ndarray,
    statistic: Statistic,
    rng: np.random.Generator,
    *,
    draws: int,
    resample: Resample,
    level: float = 0.95,
) -> Interval:
    """Estimate a statistic and its percentile confidence interval by resampling.

    Args:
        values: one row per run (seed, repeat), one column per task or cell, (n, C).
        statistic: reduces (..., n, C) to (...).
        rng: source of the resamples.
        draws: resamples; 2000 to 10000.
        resample: "rows" or "within_columns"; see the module's text.
        level: confidence level, in (0, 1).

    Raises:
        StatsError: fewer than two rows, values that are not finite, or an unknown `resample`.
    """
    values = _table(values, "a confidence interval")
    value = float(statistic(values))
    data, resampled = _resampling(values, statistic, resample)
    low, high = stats.bootstrap(
        data,
        resampled,
        n_resamples=draws,
        batch=max(1, 2_000_000 // values.size),
        vectorized=True,
        confidence_level=level,
        method="percentile",
        rng=rng,
    ).confidence_interval
    return Interval(value, float(low), float(high))


def difference(
    first: np.ndarray,
    second: np.ndarray,
    statistic: Statistic,
    rng: np.random.Generator,
    *,
    draws: int,
) -> Interval:
    """Estimate statistic(first) - statistic(second) of independent runs, (n, C) and (m, C).

    Whole runs are resampled, in each group by itself.

    Raises:
        StatsError: a group of fewer than two runs, or groups with other columns.
    """
    first, second = _pair(first, second)
    return _two_groups(first, second, lambda x, y: statistic(x) - statistic(y), rng, draws)


def probability_of_improvement(
    first: np.ndarray, second: np.ndarray, rng: np.random.Generator, *, draws: int
) -> Interval:
    """Estimate P(first > second) of two independent groups of runs, (n, C) and (m, C).

    The mean over columns and over all n m pairs of runs, ties counted half (Mann and Whitney
    1947; Agarwal et al. 2021). Whole runs are resampled, in each group by itself.

    Raises:
        StatsError: a group of fewer than two runs, or groups with other columns.
    """
    first, second = _pair(first, second)
    return _two_groups(first, second, _wins_of_pairs, rng, draws)


def wins(differences: np.ndarray) -> np.ndarray:
    """Return 1 for each positive difference, 1/2 for a tie and 0 for a loss, in the same shape.

    Their mean is the probability of improvement of pairs that belong together, such as before and
    after adaptation under the same seeds.
    """
    return (np.sign(differences) + 1) / 2


def _wins_of_pairs(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Compare all rows of (..., n, C) with all of (..., m, C)."""
    pairs = np.sign(first[..., :, None, :] - second[..., None, :, :])  # (..., n, m, C)
    return (pairs.mean(axis=(-3, -2, -1)) + 1) / 2


def _two_groups(
    first: np.ndarray,
    second: np.ndarray,
    compare: Callable[..., np.ndarray],
    rng: np.random.Generator,
    draws: int,
) -> Interval:
    """Bootstrap a comparison of two groups by their rows."""
    batch = max(1, 2_000_000 // (len(first) * len(second) * first.shape[1]))
    result = stats.bootstrap(
        (np.arange(len(first)), np.arange(len(second))),
        lambda i, j, axis: compare(first[i], second[j]),
        n_resamples=draws,
        batch=batch,
        vectorized=True,
        method="percentile",
        rng=rng,
    )
    low, high = result.confidence_interval
    return Interval(float(compare(first, second)), float(low), float(high))


def _resampling(
    values: np.ndarray, statistic: Statistic, resample: Resample
) -> tuple[tuple[np.ndarray, ...], Callable[..., np.ndarray]]:
    """Return SciPy's samples and the statistic of resamples of them."""
    if resample == "rows":
        # What SciPy resamples are row numbers, so a run keeps its columns together.
        return (np.arange(len(values)),), lambda rows, axis: statistic(values[rows])
    if resample == "within_columns":
        return tuple(values.T), lambda *columns, axis: statistic(np.stack(columns, axis=-1))
    raise StatsError(f"resample={resample!r} is unknown; choose one of: rows, within_columns")


def _table(values: np.ndarray, what: str) -> np.ndarray:
    values = np.asarray(values, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] == 0:
        raise StatsError(f"{what} needs values of shape (runs, columns), got {values.shape}")
    if len(values) < 2:
        raise StatsError(
            f"{what} needs at least 2 runs, got {len(values)}; add seeds, or report the value alone"
        )
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0]
        raise StatsError(
            f"{what} needs finite values; run {row}, column {column} is {values[row, column]}"
        )
    return values


def _pair(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    first, second = _table(first, "a comparison"), _table(second, "a comparison")
    if first.shape[1] != second.shape[1]:
        raise StatsError(
            f"a comparison needs the same columns, got {first.shape[1]} and {second.shape[1]}"
        )
    return first, second
