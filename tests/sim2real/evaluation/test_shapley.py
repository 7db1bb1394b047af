"""Shapley values against closed forms."""

import numpy as np
import pytest

from sim2real.evaluation.shapley import (
    coalitions,
    marginal_contributions,
    permutation_prefixes,
    sample_permutations,
    shapley,
)

OWN = np.array([1.0, -2.0, 0.5, 4.0])


def worth(subset: frozenset[int]) -> float:
    """An additive game with one interaction of the players 1 and 3."""
    return float(OWN[list(subset)].sum()) + 6.0 * ({1, 3} <= subset)


def test_in_an_additive_game_each_gets_its_own() -> None:
    """The closed form of a game without interactions."""
    values = {one: np.array(OWN[list(one)].sum()) for one in coalitions(4)}
    assert shapley(values, 4) == pytest.approx(OWN)


def test_an_interaction_is_shared_by_halves() -> None:
    """The closed form of a game with one interaction of two players; shares add up."""
    shares = shapley({one: np.array(worth(one)) for one in coalitions(4)}, 4)
    assert shares == pytest.approx(OWN + np.array([0.0, 3.0, 0.0, 3.0]))
    assert shares.sum() == pytest.approx(worth(frozenset(range(4))))


def test_values_of_episodes_stay_apart() -> None:
    """Arrays are shared number by number: here the game, and twice the game."""
    values = {one: worth(one) * np.array([1.0, 2.0]) for one in coalitions(4)}
    shares = shapley(values, 4)
    assert shares.shape == (4, 2)
    assert shares[:, 1] == pytest.approx(2 * shares[:, 0])


def test_drawn_orders_estimate_the_same() -> None:
    """Each order's shares add up; their mean comes near the exact ones, at no more subsets."""
    rng = np.random.default_rng(0)
    orders = sample_permutations(4, 200, rng)
    values = {one: np.array(worth(one)) for one in permutation_prefixes(orders)}
    found = marginal_contributions(values, orders)
    assert found.shape == (200, 4)
    assert found.sum(axis=1) == pytest.approx(np.full(200, worth(frozenset(range(4)))))
    assert found.mean(axis=0) == pytest.approx(OWN + np.array([0.0, 3.0, 0.0, 3.0]), abs=0.5)
    few = sample_permutations(8, 3, rng)
    assert len(few) == 4 and few[1] == few[0][::-1]
    assert len(permutation_prefixes(few)) <= 4 * 7 + 2
