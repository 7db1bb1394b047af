"""Whether the logs say anything of the friction between a robot's feet and the ground.

    findings = check_grip(problem, options, floor)      # where nothing slipped enough to tell

A foot that never slips would do the same on any ground that grips more. So the windows are
simulated with less and with more friction: where the motion stays the same, the coefficient is not
known, whatever its best value.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.problem import FOLDS, Ask, Problem
from sim2real.diagnosis.schema import Finding

NAME = "ground_friction"


def check_grip(problem: Problem, options: Sequence[Candidate], floor: float) -> list[Finding]:
    """Return a finding where friction at the feet changes less than noise does.

    Args:
        problem: all windows.
        options: the candidates; those of the ground's friction are looked at.
        floor: noise floor, in the units of errors.
    """
    own = [option for option in options if option.name == NAME]
    if not own:
        return []
    limits, none = problem.data.settings.ground, np.zeros((FOLDS, 0))
    base = problem.errors((), none[None])[0][0]
    asks = [
        Ask((option,), np.array([np.tile(factor * option.neutral, (FOLDS, 1))]))
        for option in own
        for factor in limits.grips
    ]
    moved = [float(_rms(error[0] - base, problem)) for error, _ in problem.errors_each(asks)]
    less, more = np.array(moved).reshape(len(own), -1).T
    words = []
    for option, down, up in zip(own, less, more, strict=True):
        if max(down, up) < limits.grip_floors * floor:
            words.append((option, "neither less nor more of it"))
        elif up < limits.grip_floors * floor:
            words.append((option, "no more of it"))
    return [_finding(option, told, limits.grips, floor) for option, told in words]


def _rms(change: np.ndarray, problem: Problem) -> float:
    return float(np.sqrt((change**2).sum() / max(problem.rows, 1)))


def _finding(option: Candidate, told: str, grips: Sequence[float], floor: float) -> Finding:
    where = option.effect.where
    foot = "the feet" if where is None else where
    low, high = (factor * float(option.neutral[0]) for factor in grips)
    return Finding(
        "grip",
        where,
        f"The friction between {foot} and the ground is not known: {told} would change the motion "
        f"by more than the noise ({floor:.2g}). With {low:.2g} and {high:.2g} in place of "
        f"{float(option.neutral[0]):.2g} the windows were simulated again; {foot} hardly slipped.",
        "Record motions in which feet slip: push off with growing force, brake, turn in place; "
        "until then any friction that is high enough will do.",
    )
