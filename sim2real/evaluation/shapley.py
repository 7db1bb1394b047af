"""Shapley values: what each player of a cooperative game contributes.

    needed = coalitions(3)                              # all subsets of three players
    shares = shapley({frozenset(): 0.0, ...}, 3)        # exact, (3, ...)
    orders = draw_orders(8, 24, rng)                    # of more players: drawn permutations
    shares = by_orders(values, orders)                  # (orders, 8, ...)

Values may be arrays, such as one return an episode: shares are then of the same shape. Exact values
are those of Shapley (1953); the mean over drawn orders estimates them without bias (Castro, Gómez
and Tejada, 2009). Either way the shares add up to what all players gain together.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from math import factorial

import numpy as np

Set = frozenset[int]
Order = tuple[int, ...]


def coalitions(players: int) -> list[Set]:
    """Return all subsets of n players, the smallest first."""
    every = range(players)
    return [frozenset(some) for size in range(players + 1) for some in combinations(every, size)]


def sample_permutations(players: int, count: int, rng: np.random.Generator) -> list[Order]:
    """Return an even number of drawn orders of n players, `count` or one more.

    Each is followed by its reverse, which halves their noise.
    """
    drawn = [tuple(int(i) for i in rng.permutation(players)) for _ in range((count + 1) // 2)]
    return [order for one in drawn for order in (one, one[::-1])]


def permutation_prefixes(orders: Sequence[Order]) -> list[Set]:
    """Return every set that grows along the orders, each once, the smallest first."""
    found = {frozenset(order[:size]) for order in orders for size in range(len(order) + 1)}
    return sorted(found, key=lambda one: (len(one), sorted(one)))


def shapley(values: Mapping[Set, np.ndarray], players: int) -> np.ndarray:
    """Return each player's exact share, (players, ...), of what every subset of them is worth.

    Args:
        values: of each subset, arrays of one shape.
        players: n; all 2^n subsets are there.
    """
    shares = [np.zeros_like(np.asarray(values[frozenset()], float)) for _ in range(players)]
    for subset in coalitions(players):
        size = len(subset)
        for player in set(range(players)) - subset:
            weight = factorial(size) * factorial(players - size - 1) / factorial(players)
            shares[player] = shares[player] + weight * (
                np.asarray(values[subset | {player}], float) - values[subset]
            )
    return np.array(shares)


def marginal_contributions(values: Mapping[Set, np.ndarray], orders: Sequence[Order]) -> np.ndarray:
    """Return each player's marginal contribution, (orders, players, ...).

    Args:
        values: of each prefix of the orders, arrays of one shape.
        orders: of all players.
    """
    found = []
    for order in orders:
        added: dict[int, np.ndarray] = {}
        for size, player in enumerate(order):
            before, after = frozenset(order[:size]), frozenset(order[: size + 1])
            added[player] = np.asarray(values[after], float) - values[before]
        found.append([added[player] for player in range(len(order))])
    return np.array(found)
