"""What a further value has to close to be worth it, on windows that it was not fitted to.

    pays(search, fewer, more, values=2)         # are two further values worth it?

The price of a value is told joint by joint, so that it does not depend on how many joints a robot
has: of what there is to close at the joint, of its noise floor, and of what is left there. The last
one is large where the law of an effect is not the robot's: whatever is added then mends a bad fit.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.data.score import Blocks
from sim2real.diagnosis.settings import TINY_SQUARE


class Judged(Protocol):
    """What a price is told from: a search.

    Attributes:
        problem: all windows.
        blocks: of these.
        base: errors of the model as given, (W, T, M).
        floors: noise floor of each joint, (M,).
    """

    problem: Problem
    blocks: Blocks
    base: np.ndarray
    floors: np.ndarray


def pays(search: Judged, fewer: np.ndarray, more: np.ndarray, values: int = 1) -> bool:
    """Return whether further values are worth their price on held-out windows.

    Args:
        search: whose blocks, floors and gap as given the price is told from.
        fewer: held-out errors without these values, (W, T, M).
        more: held-out errors with them.
        values: their number; a price is paid for each.
    """
    return worth(search, fewer, more) >= values and search.blocks.gain(fewer, more)[0] > 0


def worth(search: Judged, fewer: np.ndarray, more: np.ndarray) -> float:
    """Return how many prices the fall of the joints' gaps pays; see `pays`."""
    data = search.problem.data
    limits, floors = data.settings.parsimony, search.floors
    base, first, last = (np.sqrt(data.mean_squares(e)) for e in (search.base, fewer, more))
    price = np.maximum(limits.floors * floors, limits.share * (base - floors))
    price = np.maximum(price, limits.mends * (last - floors))
    return float(((first - last) / np.maximum(price, TINY_SQUARE)).sum())
