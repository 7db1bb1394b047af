"""Distances of samples in groups, against a library's and what is known of normal samples."""

import numpy as np
import pytest
from scipy import stats

from sim2real.runs.distances import PooledSamples, standardize


def pool(*samples: np.ndarray, directions: int = 16) -> PooledSamples:
    """Return a pool with one group for each array of samples."""
    group = np.repeat(np.arange(len(samples)), [len(one) for one in samples])
    rng = np.random.default_rng(0)
    return PooledSamples(np.concatenate(samples), group, rng, directions)


def test_along_a_line_it_is_the_distance_of_a_library() -> None:
    """In one dimension every direction is the line itself: SciPy's distance, weights included."""
    rng = np.random.default_rng(1)
    a, b, c = rng.normal(size=(40, 1)), rng.normal(1.0, 2.0, (70, 1)), rng.normal(size=(10, 1))
    made = pool(a, b, c)
    first, second = np.array([1.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    weights = np.concatenate([np.full(40, 1 / 80), np.full(10, 1 / 20)])  # groups weigh the same
    expected = stats.wasserstein_distance(np.concatenate([a, c])[:, 0], b[:, 0], weights)
    assert made.wasserstein(first, second) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("measure", ["wasserstein", "mmd"])
def test_what_is_alike_is_near_and_what_is_moved_is_farther(measure: str) -> None:
    """A set has no distance from itself; samples that are moved more are farther away."""
    rng = np.random.default_rng(2)
    groups = [rng.normal(shift, 1.0, (200, 3)) for shift in (0.0, 0.0, 0.3, 1.0)]
    distance = getattr(pool(*groups), measure)
    unit = np.eye(4)
    same, near, far = (distance(unit[0], unit[k]) for k in (1, 2, 3))
    assert distance(unit[0], unit[0]) == pytest.approx(0.0, abs=1e-9)
    assert same < near < far
    assert distance(unit[0], unit[3]) == pytest.approx(distance(unit[3], unit[0]))


def test_units_do_not_count() -> None:
    """Columns are in deviations of the real data, whatever their unit."""
    rng = np.random.default_rng(3)
    real = rng.normal(5.0, [1.0, 1000.0], (100, 2))
    scaled = standardize(real, real)
    np.testing.assert_allclose(scaled.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(scaled.std(axis=0), 1.0)
