"""Effects that an exam can hide, with places and sizes, as values of the emulator's own models.

    places(robot, "backlash")                       # ["base", "shoulder", ...]
    secret = choose(robot, "backlash", "elbow", rng)
    secret.entry(size=0.04)                         # an entry of an effects.yaml

A size is a positive number in which every effect grows from nothing to more than any robot shows,
so that one search serves them all. Left out, because they close no gap of a replay and are read off
the channels instead: sensor_noise, quantization, velocity_filter, packet_loss. Robots on a stand
have no contacts, and these servos no derivative gain.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import mujoco
import numpy as np

from envs.effects import EFFECTS as VOCABULARY
from envs.effects import Sizes
from envs.effects.extras import Form
from hardware.config import Robot, Servo
from hardware.emulator.hidden import EFFECTS as LAWS

Place = Literal["joint", "body", "robot"]
# What the emulator has a law for, in its order, and what closes gaps: each says its sizes itself.
EFFECTS: Mapping[str, Sizes] = {
    name: sizes for name in LAWS if name in VOCABULARY and (sizes := VOCABULARY[name].sizes)
}
FASTEST, SHARPEST = 30.0, 3000.0  # rad/s and rad/s^2, beyond what the motions ask for
HEATED = 24.0  # s over which a stalled motor would lose its torque at a size of 1
Truth = dict[str, Any]  # {effect, where, side, value, extra, joint}


@dataclass(frozen=True)
class Secret:
    """An effect that was chosen, with everything but its size."""

    effect: str  # its name
    where: str | None  # joint or body; None for the robot
    # the joint where a diagnosis should find it: for a body the one that moves it
    joint: str | None
    form: Form  # how a size becomes a value
    unit: float  # the number that a size multiplies
    direction: float  # sign, or the direction of a tilt [rad]
    side: str | None = None  # motor or link, or None
    extra: Mapping[str, float] = field(default_factory=dict)  # the effect's further scalars

    def value(self, size: float) -> float | list[float]:
        """Return the value of this size, in the effect's unit."""
        if self.form == "tilt":
            return [size * math.cos(self.direction), size * math.sin(self.direction)]
        return value_of(self.form, size, self.unit, self.direction)

    def entry(self, size: float) -> Truth:
        """Return the entry of an effects.yaml that hides this size."""
        return {
            "effect": self.effect,
            "where": self.where,
            "side": self.side,
            "value": self.value(size),
            "extra": dict(self.extra),
        }


def value_of(form: Form, size: float, unit: float, direction: float) -> float:
    """Return the value of a size with the sign of a direction; a tilt has two, and none here."""
    sign = math.copysign(1.0, direction)
    match form:
        case "add":
            return size * unit
        case "signed":
            return sign * size * unit
        case "factor":
            return math.exp(sign * size)
        case "limit":
            return unit / size
        case "mass":
            return unit * (math.exp(sign * size) - 1)
    raise ValueError(f"no value is made of a size by {form!r}")


def place_of(effect: str) -> Place:
    """Return the place that an effect acts on: an actuator is named by its joint."""
    place = VOCABULARY[effect].place
    if place == "body" or place == "robot":
        return place
    return "joint"


def places(robot: Robot, effect: str) -> list[str | None]:
    """Return where this robot can have the effect: joints, bodies, or [None] for all of it."""
    kind = place_of(effect)
    if kind == "robot":
        return [None]
    found = moved(robot)
    return list(found) if kind == "joint" else list(found.values())


def choose(robot: Robot, effect: str, where: str | None, rng: np.random.Generator) -> Secret:
    """Draw sign, side and further scalars of an effect at a place."""
    span = EFFECTS[effect]
    joint = where
    if place_of(effect) == "body":
        joint = next(name for name, body in moved(robot).items() if body == where)
    angle = float(rng.uniform(-np.pi, np.pi))
    sides = VOCABULARY[effect].sides
    side = str(rng.choice(list(sides))) if sides else None
    units = scales(robot, joint)
    extra = VOCABULARY[effect].draw_extras(units, rng)
    return Secret(effect, where, joint, span.form, units[span.unit], angle, side, extra)


def moved(robot: Robot) -> dict[str, str]:
    """Map each servo's joint to the body that it moves, in the order of the servos."""
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    joints = [int(model.actuator_trnid[model.actuator(name).id, 0]) for name in robot.names]
    return {model.joint(j).name: model.body(int(model.jnt_bodyid[j])).name for j in joints}


def scales(robot: Robot, joint: str | None) -> dict[str, float]:
    """Return the unit of sizes for the servo at a joint; for the robot, that of its first servo."""
    servo = robot.servos[0 if joint is None else list(moved(robot)).index(joint)]
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    kind, volts = servo.type, robot.supply_of(servo).voltage
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
