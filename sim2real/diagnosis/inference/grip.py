"""Whether the logs say anything of the friction between a robot's feet and the ground.

    findings = check_grip(replayer, floor)      # where nothing slipped enough to tell

A foot that never slips would do the same on any ground that grips more. So the windows are
simulated with less and with more friction: where the motion stays the same, the coefficient is not
known, whatever its best value.
"""

from collections.abc import Sequence

import numpy as np

from sim2real.diagnosis.inference.candidates import Candidate, candidates
from sim2real.diagnosis.inference.hypotheses import NONE, Hypothesis
from sim2real.diagnosis.inference.replayer import Replayer
from sim2real.diagnosis.schema import Finding

NAME = "ground_friction"


def check_grip(replayer: Replayer, floor: float) -> list[Finding]:
    """Return a finding where friction at the feet changes less than noise does.

    The floor is the noise's, in the units of errors.
    """
    data, count = replayer.data, len(replayer.every)
    own = [option for option in candidates(data, replayer.fixed) if option.name == NAME]
    if not own:
        return []
    base, _ = replayer.follow(NONE, np.zeros((count, 0)))
    grips, words = data.settings.ground.grips, []
    for option in own:
        moved = [np.tile(factor * option.neutral, (count, 1)) for factor in grips]
        errors = [replayer.follow(Hypothesis((option,)), values)[0] for values in moved]
        down, up = (_rms(error - base, data.mask) for error in errors)
        if max(down, up) < floor:
            words.append((option, "neither less nor more of it"))
        elif up < floor:
            words.append((option, "no more of it"))
    return [_finding(option, change, grips, floor) for option, change in words]


def _rms(change: np.ndarray, mask: np.ndarray) -> float:
    return float(np.sqrt((change**2).sum() / max(mask.sum() * change.shape[2], 1)))


def _finding(option: Candidate, change: str, grips: Sequence[float], floor: float) -> Finding:
    where = option.effect.where
    foot = "the feet" if where is None else where
    low, high = (factor * float(option.neutral[0]) for factor in grips)
    return Finding(
        "grip",
        where,
        f"The friction between {foot} and the ground is not known: {change} would change the "
        f"motion by more than the noise ({floor:.2g}). With {low:.2g} and {high:.2g} in place of "
        f"{float(option.neutral[0]):.2g} the windows were simulated again; {foot} hardly slipped.",
        "Record motions in which feet slip: push off with growing force, brake, turn in place; "
        "until then any friction that is high enough will do.",
    )
