"""How far the numbers of a robot are from its model's, as values of effects.

    found = list_deviations(rig, bare)              # [{"effect": "position_gain", "joint": ...}]
    names_deviation(report["causes"][0], places, found)

Where everything is a little off there is no one cause, but what is named can be true: a gain that
is called 18 % too high and is 16 % too high.
"""

import math
from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import Any

import numpy as np

from envs.effects import EFFECTS
from sim2real.exam.score import Places
from sim2real.exam.thirdparty.hidden import far_end
from sim2real.exam.thirdparty.rig import Rig

Deviation = dict[str, Any]  # {effect, joint, value}, the value in the effect's unit
GAINS = ("position_gain", "motor_strength", "supply_voltage")  # of one factor, within the limit
ALIKE = 2.0  # judged: ratio of the reported to the real deviation, or its inverse, at most


def list_deviations(rig: Rig, bare: Rig) -> list[Deviation]:
    """Return how far a robot's numbers are from those of the robot that its model describes.

    Entries are differences (N·m, N·m·s/rad, kg·m², kg, m) or factors, as the effect's value is.
    """
    found = []
    for joint in rig.driven:
        now, then = rig.joints[joint], bare.joints[joint]
        rubs, rubbed = now.friction, then.friction
        link, linked = rig.tree.mover(joint), bare.tree.mover(joint)
        end = far_end(bare, joint)
        mass = link.mass - linked.mass
        values = {
            "coulomb_friction": rubs.coulomb - rubbed.coulomb,
            "viscous_friction": rubs.viscous - rubbed.viscous,
            "armature": now.armature - then.armature,
            "link_mass": mass,
            "payload": mass,
            "center_of_mass": float((link.centre - linked.centre) @ end / np.linalg.norm(end)),
            "link_inertia": float(np.trace(link.inertia) / np.trace(linked.inertia)),
        }
        servo, served = now.servo, then.servo
        if servo is not None and served is not None:
            gain = servo.strength * (servo.kp / served.kp if served.kp else 1.0)
            values |= dict.fromkeys(GAINS, gain / served.strength)
            if served.kd:
                values["derivative_gain"] = servo.kd / served.kd
        found += [{"effect": e, "joint": joint, "value": float(v)} for e, v in values.items()]
    return found


def names_deviation(cause: Mapping[str, Any], places: Places, found: Sequence[Deviation]) -> bool:
    """Return whether a cause of a report is off in the same direction and about as far.

    One for the whole robot is held against the mean of its joints; without one number as its value
    it is none.
    """
    where, effect, value = places.of(cause["where"]), cause["effect"], cause["value"]
    own = [
        one["value"]
        for one in found
        if one["effect"] == effect and where in (None, places.of(one["joint"]))
    ]
    if not own or not isinstance(value, int | float):
        return False
    if EFFECTS[effect].hows[0] == "scale":
        if value <= 0:
            return False
        own, value = [math.log(factor) for factor in own], math.log(value)
    there = fmean(own)
    return there * value > 0 and 1 / ALIKE <= value / there <= ALIKE
