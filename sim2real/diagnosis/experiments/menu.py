"""The motions that a robot can be asked for, and what may be changed about it first.

for item in menu(spec):
item.name, item.motions, item.by_hand
if item.change is not None:
item.change(spec)               # the same to a model
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import mujoco
import numpy as np

from envs.effects.inertia import far_end
from envs.effects.servo import is_joint_servo
from envs.errors import EnvsError
from hardware.config import Robot
from hardware.excite import Kind
from sim2real.diagnosis.data.pairs import carriers
from sim2real.diagnosis.settings import DEFAULT
from sim2real.diagnosis.settings import Experiment as Limits

GRAM = 1e-3  # kg
HALF = 0.5  # of the P gain
LEAD, SPHERE = 11_340.0, 4 / 3 * np.pi  # kg/m^3; volume of a ball of radius 1
LENGTHS = (0.5, 1.0, 2.0)  # of drawn motions, in lengths of the menu's
SEEDS = 2**31  # of drawn motions: fewer than so many


class Item(NamedTuple):
    """A motion of the menu.

    Args:
        name: what it is, as a person says it.
        motions: kinds of `hardware.excite`.
        seconds: of the motion.
        size: part of the way to the nearer limit that it goes.
        seed: of its phases and poses.
        setup: seconds that it takes besides the motion, to change something by hand.
        by_hand: what to change first; None for nothing.
        change: the same, done to a model.
        override: the same for the command line of `record`; None where a hand has to do it.
    """

    name: str
    motions: tuple[Kind, ...]
    seconds: float = DEFAULT.experiment.motion_s
    size: float = DEFAULT.experiment.size
    seed: int = 0
    setup: float = 0.0
    by_hand: str | None = None
    change: Callable[[mujoco.MjSpec], None] | None = None
    override: Callable[[Robot], str] | None = None


WORDS: dict[Kind, str] = {
    "swing": "swings with the torque off",
    "ramp": "slow ramps with reversals",
    "steps": "steps",
    "chirp": "a chirp",
    "multisine": "a multisine",
    "hold": "holds, approached from both sides",
}


def drawn(
    count: int, rng: np.random.Generator, settings: Limits = DEFAULT.experiment
) -> list[Item]:
    """Return motions of one or two kinds whose duration, size, phases and poses are drawn."""
    found = []
    for _ in range(count):
        kinds = rng.permutation(list(WORDS))[: rng.integers(1, 3)]
        motions: tuple[Kind, ...] = tuple(kind for kind in WORDS if kind in kinds)
        size = float(np.exp(rng.uniform(np.log(settings.size_min), np.log(1 - settings.edge))))
        seconds = float(settings.motion_s * rng.choice(LENGTHS))
        name = f"{' and '.join(WORDS[kind] for kind in motions)}, {size:.0%} of the way"
        found.append(Item(name, motions, seconds, round(size, 3), int(rng.integers(SEEDS))))
    return found


def menu(spec: mujoco.MjSpec, settings: Limits = DEFAULT.experiment) -> list[Item]:
    """Return the motions that a robot can be asked for; what its model cannot show is left out."""
    usual = settings.motion_s, settings.size, 0
    found = [Item(name, (kind,), *usual) for kind, name in WORDS.items()]
    gain = Item(
        "steps and holds at half the P gain",
        ("steps", "hold"),
        *usual,
        settings.gain_s,
        "halve the P gain",
        partial(_scale_gain, HALF),
        lambda robot: f"robot.registers.position_p_gain={_lower_gain(robot)}",
    )
    supply = Item(
        f"steps and a chirp at {settings.supply:.0%} of the supply",
        ("steps", "chirp"),
        *usual,
        settings.hand_s,
        f"lower the supply's voltage to {settings.supply:.0%}",
        partial(_scale_supply, settings.supply),
    )
    mass, degrees = _spare_mass(spec, settings), np.rad2deg(settings.tilt)
    load = Item(
        f"ramps and steps with {mass / GRAM:.0f} g at the end",
        ("ramp", "steps"),
        *usual,
        settings.hand_s,
        f"fix {mass / GRAM:.0f} g to the end of the last link",
        partial(_load, mass),
    )
    tilt = Item(
        f"ramps and holds with the base tilted by {degrees:.0f} degrees",
        ("ramp", "hold"),
        *usual,
        settings.hand_s,
        f"tilt the base by {degrees:.0f} degrees about its y axis",
        partial(_tilt, settings.tilt),
    )
    return [*found, gain, supply, *([load] if mass > 0 else []), tilt]


def _lower_gain(robot: Robot) -> int:
    known = [{**servo.type.defaults, **robot.registers_of(servo)} for servo in robot.servos]
    gains = [registers["position_p_gain"] for registers in known]
    return max(1, round(HALF * float(np.median(gains))))


def _servos(spec: mujoco.MjSpec) -> list[int]:
    model = spec.copy().compile()
    return [i for i in range(model.nu) if is_joint_servo(model, i)]


def _scale_gain(factor: float, spec: mujoco.MjSpec) -> None:
    """Scale the position gains; what brakes stays."""
    for i in _servos(spec):
        gain, bias = (np.array(p) for p in (spec.actuators[i].gainprm, spec.actuators[i].biasprm))
        gain[0], bias[1] = factor * gain[0], factor * bias[1]
        spec.actuators[i].gainprm, spec.actuators[i].biasprm = gain, bias


def _scale_supply(factor: float, spec: mujoco.MjSpec) -> None:
    """Scale gain and largest torque: both go with the voltage, back-EMF does not."""
    _scale_gain(factor, spec)
    for i in _servos(spec):
        spec.actuators[i].forcerange = factor * np.array(spec.actuators[i].forcerange)


def _last_body(spec: mujoco.MjSpec) -> int:
    """Return the body furthest down the tree."""
    return spec.copy().compile().nbody - 1


def _spare_mass(spec: mujoco.MjSpec, settings: Limits) -> float:
    """A load worth noticing [kg], rounded to one digit; 0 where it is not clear where to put it."""
    model = spec.copy().compile()
    try:
        far_end(model, _last_body(spec))
    except EnvsError:
        return 0.0
    joints = {int(b) for b in model.jnt_bodyid}
    bodies = [b for b in range(model.nbody) if joints & set(carriers(model, b))]
    moving = float(model.body_mass[bodies].sum())
    return float(f"{settings.load * moving:.1g}")


def _load(mass: float, spec: mujoco.MjSpec) -> None:
    """Put a ball of lead at the far end of the last body."""
    index, model = _last_body(spec), spec.copy().compile()
    body = spec.body(model.body(index).name) if model.body(index).name else spec.bodies[index]
    load = body.add_body(pos=far_end(model, index))
    size, ball = [np.cbrt(mass / LEAD / SPHERE), 0, 0], mujoco.mjtGeom.mjGEOM_SPHERE
    load.add_geom(type=ball, size=size, mass=mass, contype=0, conaffinity=0)


def _tilt(angle: float, spec: mujoco.MjSpec) -> None:
    """Tilt the base about its y axis: gravity turns the other way."""
    x, y, z = spec.option.gravity
    c, s = np.cos(angle), np.sin(angle)
    spec.option.gravity = np.array([c * x + s * z, y, c * z - s * x])
