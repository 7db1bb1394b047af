"""The verdict on a gap, with the limits of `settings.Verdict`.

    verdict_of(Rest(before, after, floor, closed, low), data)

`no_gap` if the gap is within twice the noise floor or two encoder counts; `explained` if what is
left is within twice the floor, or nine tenths are closed and no more than three floors are left;
`partly_explained` from three tenths with a lower bound above zero; else `unexplained`. Where more
than four effects are needed for the former two, it is `fitted`: then there are values, and no
causes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.schema import Verdict


def resolution(data: Data) -> float:
    """Return what encoder counts hide of a gap, in the units of errors."""
    counts = np.array([joint.count / joint.scale for joint in data.joints])
    return float(data.settings.verdict.no_gap_counts * np.sqrt(np.mean(counts**2)))


def stands_out(error: np.ndarray, data: Data, floors: np.ndarray) -> bool:
    """Return whether one joint is further off than noise and rounding make, whatever the others do.

    Args:
        error: in the units of `data`, (W, T, M).
        data: the windows.
        floors: noise floor of each joint [rad or m], (M,).
    """
    counts, limits = np.array([joint.count for joint in data.joints]), data.settings.verdict
    least = np.maximum(limits.joint_floors * floors, limits.joint_counts * counts)
    return bool((np.sqrt(data.mean_squares(error)) * data.scale > least).any())


def is_no_gap(before: float, floor: float, data: Data, alone: bool) -> bool:
    """Return whether a gap is within what noise and rounding make; `alone`: see `stands_out`."""
    return not alone and before <= max(
        data.settings.verdict.no_gap_floors * floor, resolution(data)
    )


class Rest(NamedTuple):
    """What a verdict is told from.

    Args:
        before: the gap as given.
        after: what is left of it.
        floor: the noise floor.
        closed: the share that is closed.
        low: its lower bound.
        alone: whether one joint stands out, before and after.
        values: number of effects that were needed; a shared one counts once.
    """

    before: float
    after: float
    floor: float
    closed: float
    low: float
    alone: tuple[bool, bool] = (False, False)
    values: int = 1


def verdict_of(rest: Rest, data: Data) -> Verdict:
    """Return the verdict on a gap."""
    if is_no_gap(rest.before, rest.floor, data, rest.alone[0]):
        return "no_gap"
    limits = data.settings.verdict
    near = rest.after <= limits.no_gap_floors * rest.floor and not rest.alone[1]
    most = rest.closed >= limits.explained and rest.after <= max(
        limits.explained_floors * rest.floor, resolution(data)
    )
    if not (near or most) and not (rest.closed >= limits.partly and rest.low > 0):
        return "unexplained"
    if rest.values > limits.causes_max:
        return "fitted"
    return "explained" if near or most else "partly_explained"
