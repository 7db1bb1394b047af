"""What to record next, to tell effects apart that explain the logs alike.

    members = [Member("backlash at elbow", backlash), Member("joint_compliance at elbow", spring)]
    plan = next_experiment(members, spec, floor, rng=np.random.default_rng(0), robot=robot)
    plan.text                               # for a person
    plan.motions, plan.seconds              # for hardware.excite and run=record
    plan.overrides                          # for the command line

Each motion of a menu is simulated under every member with its fitted values. The one wins whose
two most similar members part fastest: evidence (the squared distance over twice the squared noise,
one sample a second, since neighbouring rows are no news) by the time that it takes, changes by hand
included.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from envs.effects import combined
from envs.effects.inertia import far_end
from envs.effects.servo import is_joint_servo
from envs.errors import EnvsError
from envs.plant import Fixed
from envs.replay import Recording
from hardware.config import BusSettings, Robot, Servo, Supply
from hardware.excite import Kind, Plan, excite
from sim2real.diagnosis.data.trial import trial
from sim2real.runs.errors import Sim2RealError

SECONDS = 8.0  # of a motion
SIZE = 0.6  # part of the way to the limits that it uses
COUNT = 2 * np.pi / 4096  # rad: the noise of a joint whose floor is not known
FEWEST = 2.0  # times the noise, that members have to be apart to be told apart
FALL, FAR = 2.0, 0.5  # s without torque, rad or m: a robot that moves further falls over
REACH, FASTEST, RATE = 1.0, 8.0, 50.0  # rad, rad/s, 1/s: of a robot known by its model alone
LOAD, TILT, SUPPLY = 0.3, np.pi / 6, 0.85  # of the moving mass, rad, factor


class Member(NamedTuple):
    """One of the explanations that the logs leave open: a label and effects with their values."""

    label: str
    fixed: tuple[Fixed, ...]


class Item(NamedTuple):
    """A motion of the menu.

    Args:
        name: what it is, as a person says it.
        motions: kinds of `hardware.excite`.
        setup: seconds that it takes besides the motion, to change something by hand.
        by_hand: what to change first; None for nothing.
        change: the same, done to a model.
        override: the same for the command line of `record`; None where a hand has to do it.
    """

    name: str
    motions: tuple[Kind, ...]
    setup: float = 0.0
    by_hand: str | None = None
    change: Callable[[mujoco.MjSpec], None] | None = None
    override: Callable[[Robot], str] | None = None


@dataclass(frozen=True)
class Experiment:
    """What to record next.

    Args:
        text: for a person.
        name: of the motion in the menu.
        motions: kinds of `hardware.excite`.
        seconds: of the motion.
        by_hand: what has to be changed first; None for nothing.
        overrides: for `python -m sim2real run=record`.
        separation: how far the two most similar members are apart, in noise floors.
        ranking: each motion of the menu and its separation, the best one first.
    """

    text: str
    name: str
    motions: tuple[Kind, ...]
    seconds: float
    by_hand: str | None
    overrides: tuple[str, ...]
    separation: float
    ranking: tuple[tuple[str, float], ...]


def next_experiment(
    members: Sequence[Member],
    spec: mujoco.MjSpec,
    floor: Mapping[str, float],
    *,
    rng: np.random.Generator,
    robot: Robot | None = None,
    fixed: Sequence[Fixed] = (),
) -> Experiment:
    """Simulate the menu under each member and return what separates them fastest.

    Args:
        members: at least two.
        spec: the model.
        floor: noise of a single run by joint [rad or m].
        rng: for phases and poses of the motions.
        robot: its limits and rate, where it is known; else the model's ranges are used.
        fixed: effects that the robot has in any case.

    Raises:
        Sim2RealError: fewer than two members, no position servo to move, or no motion that all
            members can follow.
    """
    if len(members) < 2:
        raise Sim2RealError(f"{len(members)} explanation leaves nothing to tell apart; give two")
    machine = stand_in(spec) if robot is None else robot
    falls = _falls(spec, machine)
    items = [item for item in menu(spec) if not (falls and "swing" in item.motions)]
    together = [item for item in items if item.change is None]  # one batch: the same model
    groups = [together, *([item] for item in items if item.change is not None)]
    scores = [
        (item, score)
        for group in groups
        for item, score in _scores(group, members, spec, machine, floor, fixed, rng)
    ]
    if not scores:
        raise Sim2RealError("the model diverges in every motion under one of the explanations")
    scores.sort(key=lambda pair: -(pair[1] ** 2) * SECONDS / (SECONDS + pair[0].setup))
    item, separation = scores[0]
    overrides = _overrides(item, robot)
    return Experiment(
        _text(item, members, separation, overrides),
        item.name,
        item.motions,
        SECONDS,
        item.by_hand,
        overrides,
        separation,
        tuple((other.name, score) for other, score in scores),
    )


def menu(spec: mujoco.MjSpec) -> list[Item]:
    """Return the motions that a robot can be asked for; what its model cannot show is left out."""
    found = [
        Item("swings with the torque off", ("swing",)),
        Item("slow ramps with reversals", ("ramp",)),
        Item("steps", ("steps",)),
        Item("a chirp", ("chirp",)),
        Item("a multisine", ("multisine",)),
        Item("holds, approached from both sides", ("hold",)),
    ]
    gain = Item(
        "steps and holds at half the P gain",
        ("steps", "hold"),
        5.0,
        "halve the P gain",
        _scaled_gain(0.5),
        lambda robot: f"robot.registers.position_p_gain={_half_gain(robot)}",
    )
    supply = Item(
        f"steps and a chirp at {SUPPLY:.0%} of the supply",
        ("steps", "chirp"),
        60.0,
        f"lower the supply's voltage to {SUPPLY:.0%}",
        _scaled_supply(SUPPLY),
    )
    mass = _spare_mass(spec)
    load = Item(
        f"ramps and steps with {1e3 * mass:.0f} g at the end",
        ("ramp", "steps"),
        60.0,
        f"fix {1e3 * mass:.0f} g to the end of the last link",
        _loaded(mass),
    )
    tilt = Item(
        f"ramps and holds with the base tilted by {np.rad2deg(TILT):.0f} degrees",
        ("ramp", "hold"),
        60.0,
        f"tilt the base by {np.rad2deg(TILT):.0f} degrees about its y axis",
        _tilted,
    )
    return [*found, gain, supply, *([load] if mass > 0 else []), tilt]


def stand_in(spec: mujoco.MjSpec) -> Robot:
    """Return a robot that has a servo for each position actuator of a model.

    Raises:
        Sim2RealError: the model has none.
    """
    model = spec.copy().compile()
    servos = []
    for i in range(model.nu):
        if is_joint_servo(model, i):
            joint = int(model.actuator_trnid[i, 0])
            ranges = [
                model.actuator_ctrlrange[i] if model.actuator_ctrllimited[i] else None,
                model.jnt_range[joint] if model.jnt_limited[joint] else None,
            ]
            low, high = next((r for r in ranges if r is not None), (-REACH, REACH))
            name = model.actuator(i).name
            limits = (float(low), float(high))
            servos.append(Servo(name, len(servos), "xl330-m288", 1, 2048, limits, FASTEST, None))
    if not servos:
        raise Sim2RealError("the model has no position actuator that an experiment could move")
    bus, supply = BusSettings(1_000_000, 0.0, 0.001), Supply(5.0, 0.0)
    return Robot("model", Path(), tuple(servos), {}, bus, RATE, 0.0, 0.0, REACH, 0.1, supply)


def _scores(
    items: Sequence[Item],
    members: Sequence[Member],
    spec: mujoco.MjSpec,
    robot: Robot,
    floor: Mapping[str, float],
    fixed: Sequence[Fixed],
    rng: np.random.Generator,
) -> Iterator[tuple[Item, float]]:
    """How far the two most similar members are apart in motions of one model, in noise.

    Motions in which a member diverges are left out.
    """
    spec = spec.copy()
    if items[0].change is not None:
        items[0].change(spec)
    model = spec.copy().compile()
    recordings = [record_of(item.motions, model, robot, rng) for item in items]
    paths = [trial(spec, recordings, fixed=combined(fixed, member.fixed)) for member in members]
    places = {
        model.joint(i).name: int(model.jnt_qposadr[i])
        for i in range(model.njnt)
        if int(model.jnt_type[i]) in (2, 3)
    }
    noise = np.array([max(floor.get(name, 0.0), COUNT / np.sqrt(12)) for name in places])
    columns = list(places.values())
    for number, item in enumerate(items):
        own = [path[number][:, columns] / noise for path in paths]
        if np.isfinite(own).all():
            yield item, min(_apart(one, other) for one, other in combinations(own, 2))


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    """The distance of two motions in noise, root mean square over time, summed over joints."""
    return float(np.sqrt(np.mean((one - other) ** 2, axis=0).sum()))


def record_of(
    motions: Sequence[Kind], model: mujoco.MjModel, robot: Robot, rng: np.random.Generator
) -> Recording:
    """Return a motion as a recording of commands, from rest in its middle pose."""
    home = next((k for k in range(model.nkey) if model.key(k).name == "home"), None)
    qpos = np.array(model.qpos0 if home is None else model.key_qpos[home])
    ctrl = np.zeros(model.nu) if home is None else np.array(model.key_ctrl[home])
    columns = [int(model.actuator(name).id) for name in robot.names]
    limits = np.array([servo.position for servo in robot.servos])
    pose = np.clip(ctrl[columns], *limits.T)
    edge = np.minimum(pose - limits[:, 0], limits[:, 1] - pose) < 0.05 * np.ptp(limits, axis=1)
    pose = np.where(edge, limits.mean(axis=1), pose)
    plan: Plan = excite(robot, pose, SECONDS, motions, rng, SIZE)
    commands = np.tile(ctrl, (len(plan.angles), 1))
    commands[:, columns] = plan.angles
    powered = np.ones(commands.shape, bool)
    powered[:, columns] = plan.torque[:, None]
    for column, angle in zip(columns, pose, strict=True):
        qpos[model.jnt_qposadr[model.actuator_trnid[column, 0]]] = angle
    time = np.arange(len(commands)) / robot.rate
    return Recording(time, commands, qpos, np.zeros(model.nv), powered)


def _falls(spec: mujoco.MjSpec, robot: Robot) -> bool:
    """Say whether a robot that is let go in its middle pose leaves it: it would fall over."""
    model = spec.copy().compile()
    rest = record_of(("hold",), model, robot, np.random.default_rng(0))
    rows = int(FALL * robot.rate)
    off = np.zeros((rows, model.nu), bool)
    (path,) = trial(
        spec, [rest._replace(time=rest.time[:rows], ctrl=rest.ctrl[:rows], powered=off)]
    )
    places = [
        int(model.jnt_qposadr[model.actuator_trnid[model.actuator(name).id, 0]])
        for name in robot.names
    ]
    return not bool(np.abs(path[:, places] - path[0, places]).max() < FAR)


def _overrides(item: Item, robot: Robot | None) -> tuple[str, ...]:
    name = "NAME" if robot is None else robot.name
    found = [f"robot={name}", f"motions=[{','.join(item.motions)}]", f"seconds={SECONDS:g}"]
    if item.override is not None and robot is not None:
        found.append(item.override(robot))
    return tuple(found)


def _text(
    item: Item, members: Sequence[Member], separation: float, overrides: Sequence[str]
) -> str:
    labels = [member.label for member in members]
    names = f"{', '.join(labels[:-1])} and {labels[-1]}"
    by_script = any("registers" in override for override in overrides)
    first = f"First {item.by_hand}. " if item.by_hand and not by_script else ""
    command = f"python -m sim2real run=record {' '.join(overrides)}"
    text = f"To tell {names} apart, record {item.name}: {first}`{command}`. "
    if separation < FEWEST:
        return (
            f"{text}Even there they are only {separation:.1f} times the noise apart: no motion of "
            "the menu tells them apart on this robot, so either will do in its simulator."
        )
    return f"{text}There they are {separation:.0f} times the noise floor apart."


def _half_gain(robot: Robot) -> int:
    gains = [robot.registers_of(servo).get("position_p_gain", 800) for servo in robot.servos]
    return max(1, round(0.5 * float(np.median(gains))))


def _servos(spec: mujoco.MjSpec) -> list[int]:
    model = spec.copy().compile()
    return [i for i in range(model.nu) if is_joint_servo(model, i)]


def _scaled_gain(factor: float) -> Callable[[mujoco.MjSpec], None]:
    """Scale the position gains; what brakes stays."""

    def change(spec: mujoco.MjSpec) -> None:
        for i in _servos(spec):
            gain, bias = (
                np.array(p) for p in (spec.actuators[i].gainprm, spec.actuators[i].biasprm)
            )
            gain[0], bias[1] = factor * gain[0], factor * bias[1]
            spec.actuators[i].gainprm, spec.actuators[i].biasprm = gain, bias

    return change


def _scaled_supply(factor: float) -> Callable[[mujoco.MjSpec], None]:
    """Scale gain and largest torque: both go with the voltage, back-EMF does not."""

    def change(spec: mujoco.MjSpec) -> None:
        _scaled_gain(factor)(spec)
        for i in _servos(spec):
            spec.actuators[i].forcerange = factor * np.array(spec.actuators[i].forcerange)

    return change


def _last_body(spec: mujoco.MjSpec) -> int:
    """The moving body furthest down the tree."""
    model = spec.copy().compile()
    return model.nbody - 1


def _spare_mass(spec: mujoco.MjSpec) -> float:
    """A load worth noticing [kg], rounded to one digit; 0 where it is not clear where to put it."""
    model = spec.copy().compile()
    try:
        far_end(model, _last_body(spec))
    except EnvsError:
        return 0.0
    joints = {int(b) for b in model.jnt_bodyid}
    moving = sum(float(model.body_mass[b]) for b in range(model.nbody) if _moves(model, b, joints))
    return float(f"{LOAD * moving:.1g}")


def _moves(model: mujoco.MjModel, body: int, joints: set[int]) -> bool:
    while body:
        if body in joints:
            return True
        body = int(model.body_parentid[body])
    return False


def _loaded(mass: float) -> Callable[[mujoco.MjSpec], None]:
    """Put a ball at the far end of the last body."""

    def change(spec: mujoco.MjSpec) -> None:
        index = _last_body(spec)
        model = spec.copy().compile()
        place = far_end(model, index)
        body = spec.body(model.body(index).name) if model.body(index).name else spec.bodies[index]
        load = body.add_body(pos=place)
        load.add_geom(size=[0.005, 0, 0], mass=mass, contype=0, conaffinity=0)

    return change


def _tilted(spec: mujoco.MjSpec) -> None:
    x, y, z = spec.option.gravity
    c, s = np.cos(TILT), np.sin(TILT)
    spec.option.gravity = np.array([c * x + s * z, y, c * z - s * x])
