"""What any nominal model is off by: a few per cent of what it has of its own.

No model is right to a few per cent: masses come from a scale, friction and gains from a data sheet.
A motor's strength is off with its braking, as its constant is, and without it, as its voltage is.
"""

from collections.abc import Iterator, Sequence
from itertools import product

from envs.effects import EFFECTS
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


def list_usual(data: Data, known: Sequence[Candidate] = ()) -> Iterator[Candidate]:
    """Yield what a model has of its own at each place, as a factor of it, unless it is known."""
    scale, taken = robot_scale(data), {member.law for member in known}
    for name in NAMES:
        for place, more in product(EFFECTS[name].places(scale), EFFECTS[name].variants(scale)):
            arguments = {"where": place, "how": "scale", **more}
            option = None if place is None else candidate_of(name, arguments, data.specs[0], scale)
            if option is not None and option.law not in taken:  # a model has each effect once
                yield option
