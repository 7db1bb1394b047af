"""Statistics agree with closed forms, cover what they promise, and refuse what has no answer."""

import numpy as np
import pytest
from scipy import stats as scipy_stats

from sim2real.runs.statistics import (
    Interval,
    StatsError,
    bootstrap,
    difference,
    fraction_above,
    iqm,
    mean,
    probability_of_improvement,
    wins,
)


def rng(seed: int = 0) -> np.random.Generator:
    """Return a generator of its own for each test."""
    return np.random.default_rng(seed)


def test_iqm_is_the_mean_of_the_middle_half() -> None:
    """Of 1 … 8 the middle half is 3, 4, 5, 6; outliers at the ends change nothing."""
    values = np.arange(1.0, 9.0)
    assert iqm(values.reshape(2, 4)) == 4.5
    values[[0, -1]] = -1e9, 1e9
    assert iqm(values.reshape(4, 2)) == 4.5


def test_share_counts_the_values_above() -> None:
    """A point of the performance profile; a value at the threshold is not above it."""
    assert fraction_above(2.0)(np.array([[0.0, 3.0], [2.0, 3.0]])) == 0.5


def test_statistics_reduce_the_last_two_axes() -> None:
    """A stack of tables gives the same numbers as the tables by themselves."""
    stack = rng().normal(size=(5, 3, 7))
    for statistic in (iqm, mean, fraction_above(0.1)):
        np.testing.assert_allclose(statistic(stack), [statistic(table) for table in stack])


def test_interval_of_the_mean_agrees_with_the_normal_law() -> None:
    """For many runs the bootstrap's half width is 1.96 standard errors."""
    values = rng().normal(size=(400, 1))
    found = bootstrap(values, mean, rng(1), draws=4000, resample="rows")
    half = 1.96 * values.std() / 20
    assert found.value == values.mean()
    assert found.low == pytest.approx(values.mean() - half, abs=0.1 * half)
    assert found.high == pytest.approx(values.mean() + half, abs=0.1 * half)


def test_interval_covers_the_truth_as_often_as_it_says() -> None:
    """Of 200 experiments with 30 runs each about 95 % of the intervals hold the true mean."""
    source = rng(2)
    hits = 0
    for _ in range(200):
        found = bootstrap(
            source.normal(size=(30, 2)), mean, source, draws=300, resample="within_columns"
        )
        hits += found.low <= 0 <= found.high
    assert 0.89 <= hits / 200 <= 0.99


def test_whole_runs_are_resampled_where_their_columns_belong_together() -> None:
    """Where runs differ by one offset in all cells, independent cells would look 10 x surer."""
    offsets = rng(3).normal(size=(10, 1)) + np.zeros((1, 100))
    together = bootstrap(offsets, mean, rng(), draws=2000, resample="rows")
    apart = bootstrap(offsets, mean, rng(), draws=2000, resample="within_columns")
    ratio = (together.high - together.low) / (apart.high - apart.low)
    assert ratio == pytest.approx(10, rel=0.15)


def test_equal_values_have_an_interval_of_no_width() -> None:
    """Nothing varies, so nothing is uncertain."""
    values = np.full((4, 3), 7.0)
    assert bootstrap(values, mean, rng(), draws=100, resample="rows") == Interval(7.0, 7.0, 7.0)


def test_one_generator_state_gives_one_interval() -> None:
    """The same seed gives the same numbers to the last bit."""
    values = rng().normal(size=(5, 20))
    first, second = (bootstrap(values, iqm, rng(4), draws=500, resample="rows") for _ in range(2))
    assert first == second


def test_difference_of_independent_groups_agrees_with_welch() -> None:
    """The interval of a difference of means is close to that of Welch's t test at many runs."""
    source = rng(5)
    first, second = source.normal(1.0, 1.0, (200, 1)), source.normal(0.0, 2.0, (100, 1))
    found = difference(first, second, mean, rng(), draws=4000)
    test = scipy_stats.ttest_ind(first[:, 0], second[:, 0], equal_var=False)
    expected = test.confidence_interval()
    assert found.low == pytest.approx(expected.low, abs=0.05)
    assert found.high == pytest.approx(expected.high, abs=0.05)


def test_probability_of_improvement_is_that_of_mann_and_whitney() -> None:
    """In one column it is U / (n m), ties counted half."""
    source = rng(6)
    first = source.integers(0, 5, (8, 1)).astype(float)
    second = source.integers(0, 5, (6, 1)).astype(float)
    found = probability_of_improvement(first, second, rng(), draws=500)
    u = scipy_stats.mannwhitneyu(first[:, 0], second[:, 0]).statistic
    assert found.value == pytest.approx(u / 48)
    assert found.low < found.value < found.high


def test_probability_of_improvement_has_its_closed_form_for_normal_laws() -> None:
    """P(X > Y) of two normal laws one deviation apart is Phi(1 / sqrt 2), averaged over columns."""
    source = rng(7)
    first, second = source.normal(1.0, 1.0, (60, 20)), source.normal(0.0, 1.0, (60, 20))
    found = probability_of_improvement(first, second, rng(), draws=300)
    assert found.value == pytest.approx(scipy_stats.norm.cdf(1 / np.sqrt(2)), abs=0.02)
    assert found.excludes(0.5)


def test_paired_wins_count_ties_half() -> None:
    """Two gains, one tie and one loss are worth 2.5 of 4."""
    assert wins(np.array([[1.0, 2.0], [0.0, -5.0]])).mean() == 2.5 / 4


def test_an_interval_excludes_what_lies_outside_it() -> None:
    """The ends themselves are not excluded."""
    interval = Interval(1.0, 0.5, 1.5)
    assert interval.excludes(0.4)
    assert interval.excludes(1.6)
    assert not interval.excludes(0.5)


def test_one_run_has_no_interval() -> None:
    """A single seed is refused with what to do, in every statistic that needs more."""
    one, two = np.ones((1, 3)), np.ones((2, 3))
    with pytest.raises(StatsError, match="at least 2 runs, got 1; add seeds"):
        bootstrap(one, mean, rng(), draws=10, resample="rows")
    with pytest.raises(StatsError, match="at least 2 runs"):
        difference(two, one, mean, rng(), draws=10)


def test_wrong_tables_are_refused() -> None:
    """Not finite, of the wrong shape, with other columns or resampled in an unknown way."""
    table = np.ones((3, 2))
    table[1, 0] = np.nan
    with pytest.raises(StatsError, match="run 1, column 0 is nan"):
        bootstrap(table, mean, rng(), draws=10, resample="rows")
    with pytest.raises(StatsError, match=r"shape \(runs, columns\), got \(3,\)"):
        bootstrap(np.ones(3), mean, rng(), draws=10, resample="rows")
    with pytest.raises(StatsError, match="same columns, got 2 and 3"):
        difference(np.ones((2, 2)), np.ones((2, 3)), mean, rng(), draws=10)
    with pytest.raises(StatsError, match="resample='cells' is unknown"):
        bootstrap(np.ones((2, 2)), mean, rng(), draws=10, resample="cells")  # type: ignore[arg-type]
