"""Bayesian optimization: a bowl in few calls, the same from the same seed."""

import numpy as np
import pytest

from sim2real.identification.searches import Box
from sim2real.runs.errors import Sim2RealError

pytest.importorskip("botorch", reason="pip install 'sim2real[botorch]'")

from sim2real.identification.bayesian import Bayesian

SPACE = Box(np.array([0.0, -2.0]), np.array([4.0, 2.0]), np.array([2.0, 0.0]), ("a", "b"))
LEAST = np.array([0.7, 1.2])


def bowl(points: np.ndarray, turn: int) -> np.ndarray:
    """Return squared distances from the least point, the second axis steeper."""
    return ((points - LEAST) ** 2 * [1.0, 4.0]).sum(axis=1) + 0.01


def test_it_finds_the_least_point_in_forty_calls() -> None:
    """Within a twentieth of the space; each generation asks for as many points as it should."""
    asked: list[int] = []

    def counted(points: np.ndarray, turn: int) -> np.ndarray:
        asked.append(len(points))
        assert (points >= SPACE.low).all() and (points <= SPACE.high).all()
        return bowl(points, turn)

    found = Bayesian(first=8, population=4, generations=9).minimize(counted, SPACE, seed=0)
    assert asked == [8] + [4] * 8
    assert (abs(found.best - LEAST) < 0.05 * (SPACE.high - SPACE.low)).all()
    assert found.history.shape == (9, 2, 2)


def test_one_seed_gives_one_answer() -> None:
    """And torch's generator stays as it was."""
    import torch

    before = torch.random.get_rng_state()
    one, same = (
        Bayesian(first=4, population=2, generations=3).minimize(bowl, SPACE, seed=3).history
        for _ in range(2)
    )
    np.testing.assert_array_equal(one, same)
    assert torch.equal(before, torch.random.get_rng_state())


def test_numbers_below_zero_and_a_flat_function() -> None:
    """Critics give both signs; a flat number is searched as well as another."""
    for function in (
        lambda points, turn: bowl(points, turn) - 5.0,
        lambda points, turn: np.ones(len(points)),
    ):
        found = Bayesian(first=4, population=1, generations=3).minimize(function, SPACE, seed=0)
        assert np.isfinite(found.best).all()


def test_numbers_out_of_range_are_refused() -> None:
    """In words."""
    with pytest.raises(Sim2RealError, match="first=1 must be at least 2"):
        Bayesian(first=1)
