"""The verdict on a gap, with the limits of `settings.Verdict`.

    verdict_of(Rest(before, after, floor, closed, low), data)

`no_gap` if the gap is within twice the noise floor or two encoder counts; `explained` if what is
left is within twice the floor, or nothing lasting is left at any joint and nine tenths are closed,
or one cause alone closes nineteen twentieths, or 0.85 with about a count left at every joint;
`partly_explained` from three tenths with a lower bound above zero; else `unexplained`. Where more
than four effects are needed for the former two, it is `fitted`: then there are values, and no
causes. Three effects at one joint bend into many a law that is missing: they are never `explained`.
Nor are two that act there like a third (`Effect.imitates`), nor is an effect that needs a witness
where no other channel measured it (`ties.witnesses`).

What is left on held-out windows is noise, which differs from row to row, and what the causes do not
say, which lasts: a wrong law, a missing effect, a wrong value. The mean product of errors a moment
apart is the square of the latter alone, so that a floor which is told too low excuses no law, and
one wrong joint is not averaged away by others. A single right cause may leave something lasting
too, since no simulator is exact; several wrong ones can follow almost anything, a single wrong one
cannot.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.ties import Witnessed
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.schema import Verdict


def resolution(data: Data, counts: float) -> float:
    """Return what so many encoder counts hide of a gap, in the units of errors."""
    steps = np.array([joint.count / joint.scale for joint in data.joints])
    return float(counts * np.sqrt(np.mean(steps**2)))


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


def lasting(error: np.ndarray, data: Data) -> np.ndarray:
    """Return the RMS of what lasts of errors (W, T, M), in their units, (M,).

    Root of the mean product of rows `lasting_s` apart, their autocovariance at that lag: white
    noise has none. 0 where it is negative.
    """
    total, count = np.zeros(error.shape[2]), 0
    for wrong, own, time in zip(error, data.mask, data.times(), strict=True):
        step = float(np.median(np.diff(time))) if len(time) > 1 else np.inf
        lag = max(round(min(data.settings.verdict.lasting_s / step, len(time))), 1)
        both = own[lag:] & own[:-lag]
        total += (wrong[lag:] * wrong[:-lag])[both].sum(axis=0)
        count += int(both.sum())
    return np.sqrt(np.maximum(total / max(count, 1), 0.0))


def is_open(error: np.ndarray, data: Data, floors: np.ndarray) -> bool:
    """Return whether something lasting is left at a joint, beyond its floor and its encoder.

    Args:
        error: held out, in the units of `data`, (W, T, M).
        data: the windows.
        floors: noise floor of each joint [rad or m], (M,).
    """
    counts, limits = np.array([joint.count for joint in data.joints]), data.settings.verdict
    most = np.maximum(limits.explained_floors * floors, limits.explained_counts * counts)
    return bool((lasting(error, data) * data.scale > most).any())


def is_resolved(error: np.ndarray, data: Data) -> bool:
    """Return whether every joint is within what its encoder resolves; never of unrounded readings.

    Args:
        error: held out, in the units of `data`, (W, T, M).
        data: the windows.
    """
    counts = data.settings.verdict.explained_counts * np.array([j.count for j in data.joints])
    return bool((np.sqrt(data.mean_squares(error)) * data.scale <= counts).all())


def is_no_gap(before: float, floor: float, data: Data, alone: bool) -> bool:
    """Return whether a gap is within what noise and rounding make; `alone`: see `stands_out`."""
    limits = data.settings.verdict
    least = max(limits.no_gap_floors * floor, resolution(data, limits.no_gap_counts))
    return not alone and before <= least


class Rest(NamedTuple):
    """What a verdict is told from.

    Args:
        before: the gap as given.
        after: what is left of it.
        floor: the noise floor.
        closed: the share that is closed.
        low: its lower bound.
        alone: whether one joint stands out, before and after.
        unsaid: whether something lasting is left; see `is_open`.
        values: number of effects that were needed; a shared one counts once.
        crowd: number of them at the joint that has most; a shared one counts nowhere.
        form: whether the effects' laws hold wherever they were tried; see `contradicted`.
        resolved: whether what is left is less than the encoders show; see `is_resolved`.
        witnessed: whether no effect lacks a witness that it needs; see `unwitnessed`.
        plain: whether no two effects at a joint act like a third; see `imitations`.
    """

    before: float
    after: float
    floor: float
    closed: float
    low: float
    alone: tuple[bool, bool] = (False, False)
    unsaid: bool = False
    values: int = 1
    crowd: int = 1
    form: bool = True
    resolved: bool = False
    witnessed: bool = True
    plain: bool = True


def verdict_of(rest: Rest, data: Data) -> Verdict:
    """Return the verdict on a gap."""
    if is_no_gap(rest.before, rest.floor, data, rest.alone[0]):
        return "no_gap"
    limits = data.settings.verdict
    near = rest.after <= limits.no_gap_floors * rest.floor and not rest.alone[1]
    sole = rest.values == 1 and rest.form
    most = rest.closed >= limits.explained and not rest.unsaid
    most |= sole and rest.closed >= limits.sole and rest.low >= limits.explained
    most |= sole and rest.closed >= limits.resolved and rest.resolved
    if not (near or most) and not (rest.closed >= limits.partly and rest.low > 0):
        return "unexplained"
    if rest.values > limits.causes_max:
        return "fitted"
    return "explained" if (near or most) and is_sound(rest, data) else "partly_explained"


def is_sound(rest: Rest, data: Data) -> bool:
    """Return whether such causes may explain a gap at all, however little they leave."""
    limits = data.settings.verdict
    few = rest.values <= limits.causes_max and rest.crowd <= limits.joint_causes_max
    return few and rest.witnessed and rest.plain


def crowd_of(members: Sequence[Candidate]) -> int:
    """Return how many effects are at the joint that has most of them, shared ones left out."""
    places = [member.joint for member in members if member.joint is not None]
    return max(map(places.count, places), default=0)


def imitations(members: Sequence[Candidate]) -> list[tuple[Candidate, Candidate, str]]:
    """Return the pairs of effects at one joint that act like another effect, and like what.

    Effects of the whole robot count as at one joint.

    Args:
        members: what was found.
    """
    return [
        (one, other, like)
        for one, other in permutations(members, 2)
        if one.joint == other.joint
        and (like := one.effect.imitates.get(other.name))
        # of a pair in which both know it, the first one tells
        and (one.name < other.name or one.name not in other.effect.imitates)
    ]


def unwitnessed(members: Sequence[Candidate], witnessed: Witnessed) -> list[Candidate]:
    """Return the effects that need a witness and have none.

    Args:
        members: what was found.
        witnessed: effects that channels measured; see `ties.witnesses`.
    """
    places = [(member.name, member.effect.where) for member in members]
    return [
        member
        for member, place in zip(members, places, strict=True)
        if member.effect.needs_measured_channel and place not in witnessed
    ]
