"""What an exam can hide, where, and in which sizes: numbers for the emulator's own laws.

    places(robot, "backlash")                       # ["base", "shoulder", ...]
    secret = choose(robot, "backlash", "elbow", rng)
    secret.entry(size=0.04)                         # an entry of an effects.yaml

A size is a positive number in which every effect grows from nothing to more than any robot shows,
so that one search serves them all. Left out, because they close no gap of a replay and are read off
the channels instead: sensor_noise, quantization, velocity_filter, packet_loss. Robots on a stand
have no contacts, and these servos no derivative gain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import mujoco
import numpy as np

from hardware.config import Robot, Servo

Form = Literal["add", "signed", "factor", "limit", "mass", "tilt"]
Place = Literal["joint", "body", "robot"]


class Range(NamedTuple):
    """The sizes of one effect, as multiples of a number that the robot itself has.

    Args:
        place: what it acts on.
        form: how a size becomes a value: `add` size * unit, `signed` the same with a drawn sign,
            `factor` exp(± size), `limit` unit / size, `mass` unit * (exp(± size) - 1), `tilt` a
            rotation by size about a drawn horizontal axis.
        unit: the number: see `scales`.
        low: the least size that is tried.
        high: the largest.
    """

    place: Place
    form: Form
    unit: str
    low: float
    high: float


EFFECTS: Mapping[str, Range] = {
    "coulomb_friction": Range("joint", "add", "stall", 2e-3, 0.3),
    "viscous_friction": Range("joint", "add", "braking", 0.02, 10.0),
    "stribeck_friction": Range("joint", "add", "stall", 2e-3, 0.3),
    "load_dependent_friction": Range("joint", "add", "one", 5e-3, 0.6),
    "backlash": Range("joint", "add", "one", 3e-3, 0.25),
    "joint_compliance": Range("joint", "add", "softness", 0.01, 3.0),
    "cogging": Range("joint", "add", "stall", 2e-3, 0.2),
    "armature": Range("joint", "add", "inertia", 0.03, 10.0),
    "encoder_offset": Range("joint", "signed", "one", 3e-3, 0.3),
    "position_gain": Range("joint", "factor", "one", 0.02, 1.2),
    "motor_strength": Range("joint", "factor", "one", 0.02, 0.8),
    "torque_limit": Range("joint", "limit", "stall", 1.05, 20.0),
    "thermal_derating": Range("joint", "add", "heating", 1e-3, 100.0),
    "dead_zone": Range("joint", "add", "one", 3e-3, 0.12),
    "profile_velocity": Range("joint", "limit", "fastest", 1.0, 100.0),
    "profile_acceleration": Range("joint", "limit", "sharpest", 1.0, 1000.0),
    "supply_voltage": Range("robot", "factor", "one", 0.02, 0.6),
    "supply_sag": Range("robot", "add", "winding", 0.01, 2.0),
    "command_delay": Range("robot", "add", "one", 1e-3, 0.1),
    "observation_delay": Range("robot", "add", "one", 1e-3, 0.1),
    "link_mass": Range("body", "mass", "mass", 0.02, 1.2),
    "center_of_mass": Range("body", "signed", "length", 0.03, 1.2),
    "payload": Range("body", "add", "mass", 0.01, 2.5),
    "gravity_tilt": Range("robot", "tilt", "one", 5e-3, 0.5),
}
SIDES = ("backlash", "joint_compliance")
FASTEST, SHARPEST = 30.0, 3000.0  # rad/s and rad/s^2, beyond what the motions ask for
HEATED = 24.0  # s over which a stalled motor would lose its torque at a size of 1
Truth = dict[str, Any]  # {effect, where, side, value, extra, joint}


@dataclass(frozen=True)
class Secret:
    """An effect that was chosen, with everything but its size.

    Args:
        effect: its name.
        where: joint or body; None for the robot.
        joint: the joint where a diagnosis should find it: for a body the one that moves it.
        form: how a size becomes a value.
        unit: the number that a size multiplies.
        direction: sign, or the direction of a tilt [rad].
        side: motor or link, or None.
        extra: the effect's further scalars.
    """

    effect: str
    where: str | None
    joint: str | None
    form: Form
    unit: float
    direction: float
    side: str | None = None
    extra: Mapping[str, float] = field(default_factory=dict)

    def value(self, size: float) -> float | list[float]:
        """Return the value of this size, in the effect's unit."""
        sign = math.copysign(1.0, self.direction)
        match self.form:
            case "add":
                return size * self.unit
            case "signed":
                return sign * size * self.unit
            case "factor":
                return math.exp(sign * size)
            case "limit":
                return self.unit / size
            case "mass":
                return self.unit * (math.exp(sign * size) - 1)
            case "tilt":
                return [size * math.cos(self.direction), size * math.sin(self.direction)]

    def entry(self, size: float) -> Truth:
        """Return the entry of an effects.yaml that hides this size."""
        return {
            "effect": self.effect,
            "where": self.where,
            "side": self.side,
            "value": self.value(size),
            "extra": dict(self.extra),
        }


def places(robot: Robot, effect: str) -> list[str | None]:
    """Return where this robot can have the effect: joints, bodies, or [None] for all of it."""
    kind = EFFECTS[effect].place
    if kind == "robot":
        return [None]
    found = moved(robot)
    return list(found) if kind == "joint" else list(found.values())


def choose(robot: Robot, effect: str, where: str | None, rng: np.random.Generator) -> Secret:
    """Draw sign, side and further scalars of an effect at a place."""
    span = EFFECTS[effect]
    joint = where
    if span.place == "body":
        joint = next(name for name, body in moved(robot).items() if body == where)
    angle = float(rng.uniform(-np.pi, np.pi))
    side = str(rng.choice(["motor", "link"])) if effect in SIDES else None
    units = scales(robot, joint)
    extra = _extra(effect, units, rng)
    return Secret(effect, where, joint, span.form, units[span.unit], angle, side, extra)


def moved(robot: Robot) -> dict[str, str]:
    """Return the body that each servo's joint moves, by joint, in the order of the servos."""
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    joints = [int(model.actuator_trnid[model.actuator(name).id, 0]) for name in robot.names]
    return {model.joint(j).name: model.body(int(model.jnt_bodyid[j])).name for j in joints}


def scales(robot: Robot, joint: str | None) -> dict[str, float]:
    """Return what sizes multiply, of the servo at a joint; of the first one for the robot."""
    servo = robot.servos[0 if joint is None else list(moved(robot)).index(joint)]
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    kind, volts = servo.type, robot.supply.voltage
    at = model.actuator_trnid[model.actuator(servo.name).id, 0]
    body = int(model.jnt_bodyid[at])
    stall = kind.stall_torque(volts)
    return {
        "one": 1.0,
        "stall": stall,
        "braking": kind.back_emf_damping,
        "softness": 1 / kind.position_gain(_gain(robot, servo), volts),
        "inertia": float(model.dof_M0[model.jnt_dofadr[at]]),
        "winding": kind.resistance,
        "heating": 1 / (stall**2 * HEATED),
        "fastest": FASTEST,
        "sharpest": SHARPEST,
        "mass": float(model.body_mass[body]),
        "length": _length(model, body),
    }


def _gain(robot: Robot, servo: Servo) -> int:
    return robot.registers_of(servo)["position_p_gain"]


def _length(model: mujoco.MjModel, body: int) -> float:
    """Return how long a link is: to its child, else twice the way to its centre of mass [m]."""
    children = np.flatnonzero(model.body_parentid == body)
    ways = np.linalg.norm(model.body_pos[children], axis=1) if len(children) else np.zeros(1)
    return float(ways.max() or 2 * np.linalg.norm(model.body_ipos[body]))


def _extra(effect: str, units: Mapping[str, float], rng: np.random.Generator) -> dict[str, float]:
    """Draw the further scalars of an effect."""
    match effect:
        case "stribeck_friction":
            return {"speed": float(np.exp(rng.uniform(np.log(0.2), np.log(1.0))))}
        case "cogging":
            return {"count": float(rng.integers(6, 31)), "phase": float(rng.uniform(-3, 3))}
        case "joint_compliance":  # 5 to 30 % of critical damping, were it as soft as the servo
            ratio = rng.uniform(0.05, 0.3)
            return {"damping": float(2 * ratio * math.sqrt(units["inertia"] / units["softness"]))}
        case "thermal_derating":
            return {"decay": float(rng.choice([0.0, 0.02]))}
    return {}
