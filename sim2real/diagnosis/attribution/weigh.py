"""What each cause closes, and which are needed at all.

weighed = weigh(search, found, rng)
weighed.fit.members     # the causes, the largest share first
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.attribution.attribute import Found, Search
from sim2real.diagnosis.attribution.background import shifts
from sim2real.diagnosis.attribution.equivalents import with_rivals
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.parsimony import dropped, neutral
from sim2real.diagnosis.attribution.quantify import (
    Spread,
    coalitions,
    intervals,
    one_less,
    shapley,
    without,
)
from sim2real.diagnosis.settings import TINY_SQUARE

Set = frozenset[int]


class Weighed(NamedTuple):
    """Causes none of whose intervals holds neutral.

    Args:
        found: with the rivals of each cause.
        order: the causes' numbers in it, the largest share first, (n,).
        fit: in that order.
        subsets: held-out errors without some causes, by the numbers of the others, (W, T, M) each.
        shares: of the closable gap, by number, (n,).
        spread: the intervals of values, in order.
    """

    found: Found
    order: list[int]
    fit: Fit
    subsets: dict[Set, np.ndarray]
    shares: np.ndarray
    spread: Spread

    def rests(self) -> list[np.ndarray]:
        """Return held-out errors without each cause, in order."""
        return _rests(self.subsets, self.order)


def weigh(search: Search, found: Found, rng: np.random.Generator) -> Weighed:
    """Return the causes in the order of what they close, without those that may be nil.

    Args:
        search: after its run.
        found: what it returned.
        rng: for the intervals.
    """
    blocks, limits = search.blocks, search.problem.data.settings.causes
    subsets, shares = _weighed(search, found)
    order = [int(i) for i in np.argsort(-shares)]
    fit = without(found.fit, order)
    after = blocks.rms(found.error)
    rests = np.array([blocks.rms(rest) for rest in _rests(subsets, order)])
    least = limits.left_min * after**2 + TINY_SQUARE
    left = after / np.sqrt(np.maximum(rests**2 - after**2, least))
    spread = Spread(np.zeros((0, 2)), np.zeros((0, 0)))
    if order:
        beside = shifts(search, fit)
        spread = intervals(search.problem, fit, left, rng, blocks.seconds, beside)
    if nil := neutral(fit, spread.ends):
        return weigh(search, dropped(search, found, [order[number] for number in nil]), rng)
    return Weighed(with_rivals(search, found), order, fit, subsets, shares, spread)


def _rests(subsets: dict[Set, np.ndarray], order: list[int]) -> list[np.ndarray]:
    every = frozenset(order)
    return [subsets[every - {number}] for number in order]


def _weighed(search: Search, found: Found) -> tuple[dict[Set, np.ndarray], np.ndarray]:
    """Return held-out errors without some causes, and each cause's share of the closable gap, (n,).

    Of few causes every subset is fitted anew, and the shares are Shapley's. Of many only the others
    are looked at without each, and the shares are as large as these falls, in proportion.
    """
    blocks, room = search.blocks, max(search.before - search.floor, TINY_SQUARE)
    if len(found.fit.members) <= search.problem.data.settings.causes.subsets_max:
        subsets = coalitions(search.problem, search.racing, found.fit, found.error)
        gaps = {subset: blocks.rms(error) for subset, error in subsets.items()}
        worth = {s: min((search.before - gap) / room, 1.0) for s, gap in gaps.items()}
        return subsets, np.minimum(shapley(worth, len(found.fit.members)), 1.0)
    subsets, every = one_less(search.problem, found.fit, found.error), range(len(found.fit.members))
    after = blocks.rms(found.error)
    falls = np.array([blocks.rms(subsets[frozenset(every) - {i}]) - after for i in every])
    falls = np.maximum(falls, 0.0)
    closed = min((search.before - after) / room, 1.0)
    return subsets, closed * falls / max(falls.sum(), TINY_SQUARE)
