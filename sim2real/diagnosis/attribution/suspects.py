"""Which candidates could cause what is wrong, and which could stand in each other's place.

options = suspects(search, fit, error)
meets(option, member)                       # there is a joint whose motion both change
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from envs.effects.base import PLAIN
from sim2real.diagnosis.attribution.candidates import Candidate, in_the_way
from sim2real.diagnosis.attribution.cogging import with_ripples
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.settings import TINY_SQUARE


class Searched(Protocol):
    """What suspects are told from: a search.

    Attributes:
        problem: all windows.
        options: the candidates.
        floor: noise floor, in the units of errors.
    """

    problem: Problem
    options: Sequence[Candidate]
    floor: float


def suspects(search: Searched, fit: Fit, error: np.ndarray) -> list[Candidate]:
    """Return the candidates that could cause what is wrong: at joints with a gap, or above.

    What all joints share, and takes its time to simulate, only if several have one.

    Args:
        search: whose candidates.
        fit: what is known already.
        error: what is wrong beside it, (W, T, M).
    """
    data = search.problem.data
    taken = {(m.name, m.effect.where) for m in fit.members}
    square = data.mean_squares(error)
    excess = np.maximum(square - search.floor**2, 0.0)
    names = [joint.name for joint in data.joints]
    least = data.settings.search.suspect * max(excess.sum(), TINY_SQUARE)
    guilty = {name for name, e in zip(names, excess, strict=True) if e > least}
    found = [
        option
        for option in search.options
        if (option.name, option.effect.where) not in taken
        and not any(in_the_way(option.effect, m.effect) for m in fit.members)
        and (option.joint is None or guilty & set(option.shown))
        and (len(guilty) > 1 or not option.shared or option.group == PLAIN)
    ]
    return [
        with_ripples(option, data, error) if option.name == "cogging" else option
        for option in found
    ]


def meets(one: Candidate, other: Candidate) -> bool:
    """Return whether there is a joint whose motion both change."""
    everywhere = one.joint is None or other.joint is None
    return everywhere or not set(one.shown).isdisjoint(other.shown)
