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
HALF = 0.5  # of the P gain; of gravity, which a tilted base takes to the side
TILT = np.arcsin(HALF)  # rad
LEAD, SPHERE = 11_340.0, 4 / 3 * np.pi  # kg/m^3; volume of a ball of radius 1
LENGTHS = (0.5, 1.0, 2.0)  # of drawn motions, in lengths of the menu's
SEEDS = 2**31  # of drawn motions: fewer than so many


class Item(NamedTuple):
    """A motion of the menu."""

    name: str  # what it is, as a person says it
    motions: tuple[Kind, ...]  # kinds of `hardware.excite`
    seconds: float = DEFAULT.experiment.motion_s  # of the motion
    size: float = DEFAULT.experiment.size  # part of the way to the nearer limit that it goes
    seed: int = 0  # of its phases and poses
    by_hand: str | None = None  # what to change first; None for nothing
    change: Callable[[mujoco.MjSpec], None] | None = None  # the same, done to a model
    override: Callable[[Robot], str] | None = None  # the same for `record`; None: by hand alone

    @property
    def needs_hand(self) -> bool:
        """Whether somebody has to change something first; a register is written in no time."""
        return self.by_hand is not None and self.override is None


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
    item = partial(Item, seconds=settings.motion_s, size=settings.size)
    supply, mass, degrees = settings.supply, _spare_mass(spec, settings), np.rad2deg(TILT)
    load = item(
        f"ramps and steps with {mass / GRAM:.0f} g at the end",
        ("ramp", "steps"),
        by_hand=f"fix {mass / GRAM:.0f} g to the end of the last link",
        change=partial(_load, mass),
    )
    return [
        *(item(name, (kind,)) for kind, name in WORDS.items()),
        item(
            "steps and holds at half the P gain",
            ("steps", "hold"),
            by_hand="halve the P gain",
            change=partial(_scale, HALF, 1.0),
            override=lambda robot: f"robot.registers.position_p_gain={_lower_gain(robot)}",
        ),
        item(
            f"steps and a chirp at {supply:.0%} of the supply",
            ("steps", "chirp"),
            by_hand=f"lower the supply's voltage to {supply:.0%}",
            change=partial(_scale, supply, supply),  # back-EMF does not go with the voltage
        ),
        *([load] if mass > 0 else []),
        item(
            f"ramps and holds with the base tilted by {degrees:.0f} degrees",
            ("ramp", "hold"),
            by_hand=f"tilt the base by {degrees:.0f} degrees about its y axis",
            change=_tilt,
        ),
    ]


def _lower_gain(robot: Robot) -> int:
    known = [{**servo.type.defaults, **robot.registers_of(servo)} for servo in robot.servos]
    gains = [registers["position_p_gain"] for registers in known]
    return max(1, round(HALF * float(np.median(gains))))


def _scale(gain: float, torque: float, spec: mujoco.MjSpec) -> None:
    """Scale the position gains and the largest torques; what brakes stays."""
    model = spec.copy().compile()
    for i in filter(partial(is_joint_servo, model), range(model.nu)):
        actuator = spec.actuators[i]
        actuator.gainprm[0] *= gain
        actuator.biasprm[1] *= gain
        actuator.forcerange = torque * np.array(actuator.forcerange)


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


def _tilt(spec: mujoco.MjSpec) -> None:
    """Tilt the base about its y axis: gravity turns the other way."""
    x, y, z = spec.option.gravity
    c, s = np.cos(TILT), np.sin(TILT)
    spec.option.gravity = np.array([c * x + s * z, y, c * z - s * x])
