"""Random numbers as a function of (seed, stream, index)."""

import numpy as np
import pytest
from scipy import stats

from envs.noise import normal, uniform

SEEDS = np.arange(4000, dtype=np.uint64)


@pytest.mark.parametrize("seeds", [SEEDS, SEEDS * np.uint64(1 << 40), ~SEEDS])
def test_laws(seeds: np.ndarray) -> None:
    """Neighbouring seeds give uniform and normal numbers, in each column."""
    u, z = uniform(seeds, 0, 3), normal(seeds, 0, 3)
    for column in range(3):
        assert stats.kstest(u[:, column], "uniform").pvalue > 1e-3
        assert stats.kstest(z[:, column], "norm").pvalue > 1e-3


def test_no_correlation() -> None:
    """Numbers of neighbouring seeds, streams and indices do not tell of each other."""
    u = uniform(SEEDS, 0, 2)
    pairs = [(u[:-1, 0], u[1:, 0]), (u[:, 0], u[:, 1]), (u[:, 0], uniform(SEEDS, 1, 1)[:, 0])]
    for a, b in pairs:
        assert abs(np.corrcoef(a, b)[0, 1]) < 0.06
    z = normal(SEEDS, 0, 2)
    assert abs(np.corrcoef(z.T)[0, 1]) < 0.06
    assert abs(np.corrcoef((z**2).T)[0, 1]) < 0.06


@pytest.mark.parametrize("law", [uniform, normal])
def test_rows_are_independent_of_the_call(law: type) -> None:
    """A seed's numbers do not depend on the seeds beside it; streams may differ by row."""
    whole = law(SEEDS, 3, 5)
    np.testing.assert_array_equal(law(SEEDS[17:18], 3, 5)[0], whole[17])
    streams = np.arange(len(SEEDS))
    np.testing.assert_array_equal(law(SEEDS, streams, 5)[3], whole[3])


def test_more_numbers_go_on() -> None:
    """A longer row of uniform numbers begins with the shorter one."""
    np.testing.assert_array_equal(uniform(SEEDS, 0, 8)[:, :3], uniform(SEEDS, 0, 3))
