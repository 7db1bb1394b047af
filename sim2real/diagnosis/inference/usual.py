"""What any nominal model is off by: a few per cent of what it has of its own.

No model is right to a few per cent: masses come from a scale, friction and gains from a data sheet.
A motor's strength is off with its braking, as its constant is, and without it, as its voltage is.
Dry friction is rigid in a model, and bends before it slips in a joint (presliding).
"""

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from envs.effects import EFFECTS, Effect
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.inference.candidates import Candidate, candidate_of
from sim2real.diagnosis.inference.probes import robot_scale

NAMES = (
    "link_mass",
    "link_inertia",
    "armature",
    "coulomb_friction",
    "viscous_friction",
    "position_gain",
    "derivative_gain",
    "motor_strength",
)
BRISTLES = "stribeck_friction"  # whose bristles all dry friction of a joint bends


def list_usual(data: Data, known: Sequence[Candidate] = ()) -> Iterator[Candidate]:
    """Yield what a model has of its own at each place, as a factor of it, unless it is known."""
    scale, taken = robot_scale(data), {member.label for member in known}
    for name in NAMES:
        for place, more in product(EFFECTS[name].places(scale), EFFECTS[name].variants(scale)):
            arguments = {"where": place, "how": "scale", **more}
            option = None if place is None else candidate_of(name, arguments, data.specs[0], scale)
            if option is not None and option.label not in taken:  # a model has each effect once
                yield option


def list_bristles(
    data: Data, bends: np.ndarray, known: Sequence[Effect] = ()
) -> Iterator[Candidate]:
    """Yield bristles at each joint that bend so far before it slips, (M,), unless they are known.

    No friction is added.
    """
    scale, taken = robot_scale(data), {one.where for one in known if one.name == BRISTLES}
    for joint, bend in zip(data.joints, bends, strict=True):
        if taken.isdisjoint((joint.name, None)):
            arguments = {"where": joint.name, "bristle": float(bend)}
            option = candidate_of(BRISTLES, arguments, data.specs[0], scale)
            if option is not None:
                yield option
