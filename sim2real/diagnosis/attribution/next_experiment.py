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

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, starmap
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from envs.effects import combined
from envs.effects.servo import is_joint_servo
from envs.plant import Fixed
from envs.replay import Recording
from hardware.config import BusSettings, Robot, Servo, Supply
from hardware.excite import Kind, Plan, excite
from sim2real.diagnosis.attribution.experiment_menu import Item, menu
from sim2real.diagnosis.data.noise_floor import rounding
from sim2real.diagnosis.data.pairs import is_scalar
from sim2real.diagnosis.data.trial import trial
from sim2real.diagnosis.settings import DEFAULT
from sim2real.diagnosis.settings import Experiment as Limits
from sim2real.runs.errors import Sim2RealError


class Member(NamedTuple):
    """One of the explanations that the logs leave open: a label and effects with their values."""

    label: str
    fixed: tuple[Fixed, ...]


@dataclass(frozen=True)
class Experiment:
    """What to record next.

    Args:
        text: the recommendation in words.
        name: the motion's name in the menu.
        motions: kinds of `hardware.excite`.
        seconds: the duration of the motion.
        by_hand: what has to be changed first; None for nothing.
        overrides: overrides for `sim2real record`.
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
    settings: Limits = DEFAULT.experiment,
) -> Experiment:
    """Simulate the menu under each member and return what separates them fastest.

    Args:
        members: at least two explanations.
        spec: the model.
        floor: noise of a single run by joint [rad or m].
        rng: the random generator of the motions' phases and poses.
        robot: its limits and rate, where it is known; else the model's ranges are used.
        fixed: effects that the robot has in any case.
        settings: the motions, and the robot where only its model is known.

    Raises:
        Sim2RealError: fewer than two members, no position servo to move, or no motion that all
            members can follow.
    """
    if len(members) <= 1:
        raise Sim2RealError(f"{len(members)} explanation leaves nothing to separate; give two")
    machine = stand_in(spec, settings) if robot is None else robot
    falls = _falls(spec, machine, rng.spawn(1)[0], settings)
    items = [item for item in menu(spec, settings) if not (falls and "swing" in item.motions)]
    together = [item for item in items if item.change is None]  # one batch: the same model
    groups = [together, *([item] for item in items if item.change is not None)]
    scores = [
        (item, score)
        for group in groups
        for item, score in _scores(group, members, spec, machine, floor, fixed, rng, settings)
    ]
    if not scores:
        raise Sim2RealError("the model diverges in every motion under one of the explanations")
    seconds = settings.motion_s
    scores.sort(key=lambda pair: -(pair[1] ** 2) * seconds / (seconds + pair[0].setup))
    item, separation = scores[0]
    overrides = _overrides(item, robot, settings)
    return Experiment(
        _text(item, members, separation, overrides, settings),
        item.name,
        item.motions,
        seconds,
        item.by_hand,
        overrides,
        separation,
        tuple((other.name, score) for other, score in scores),
    )


def stand_in(spec: mujoco.MjSpec, settings: Limits = DEFAULT.experiment) -> Robot:
    """Return a robot that has a servo for each position actuator of a model.

    Raises:
        Sim2RealError: the model has none.
    """
    model, limits = spec.copy().compile(), settings
    servos = []
    for i in range(model.nu):
        if is_joint_servo(model, i):
            joint = int(model.actuator_trnid[i, 0])
            ranges = [
                model.actuator_ctrlrange[i] if model.actuator_ctrllimited[i] else None,
                model.jnt_range[joint] if model.jnt_limited[joint] else None,
            ]
            low, high = next((r for r in ranges if r is not None), (-limits.reach, limits.reach))
            name = model.actuator(i).name
            about = (limits.servo, 1, limits.zero_count, (float(low), float(high)), limits.fastest)
            servos.append(Servo(name, len(servos), *about, None))
    if not servos:
        raise Sim2RealError("the model has no position actuator that an experiment could move")
    bus, supply = BusSettings(limits.baud, 0.0, limits.answer_s), Supply(limits.supply_v, 0.0)
    rest = (limits.rate_hz, 0.0, 0.0, limits.reach, limits.margin, supply)
    return Robot("model", Path(), tuple(servos), {}, bus, *rest)


def _scores(
    items: Sequence[Item],
    members: Sequence[Member],
    spec: mujoco.MjSpec,
    robot: Robot,
    floor: Mapping[str, float],
    fixed: Sequence[Fixed],
    rng: np.random.Generator,
    settings: Limits,
) -> Iterator[tuple[Item, float]]:
    """How far the two most similar members are apart in motions of one model, in noise.

    Motions in which a member diverges are left out.
    """
    spec = spec.copy()
    if items[0].change is not None:
        items[0].change(spec)
    model = spec.copy().compile()
    recordings = [record_of(item.motions, model, robot, rng, settings) for item in items]
    paths = [trial(spec, recordings, fixed=combined(fixed, member.fixed)) for member in members]
    places = {
        model.joint(i).name: int(model.jnt_qposadr[i])
        for i in range(model.njnt)
        if is_scalar(model, i)
    }
    noise = np.array([max(floor.get(name, 0.0), rounding(settings.count)) for name in places])
    columns = list(places.values())
    for number, item in enumerate(items):
        own = [path[number][:, columns] / noise for path in paths]
        if np.isfinite(own).all():
            yield item, min(starmap(_apart, combinations(own, 2)))


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    """The distance of two motions in noise, root mean square over time, summed over joints."""
    return float(np.sqrt(np.mean((one - other) ** 2, axis=0).sum()))


def record_of(
    motions: Sequence[Kind],
    model: mujoco.MjModel,
    robot: Robot,
    rng: np.random.Generator,
    settings: Limits = DEFAULT.experiment,
) -> Recording:
    """Return a motion as a recording of commands, from rest in its middle pose."""
    home = next((k for k in range(model.nkey) if model.key(k).name == "home"), None)
    qpos = np.array(model.qpos0 if home is None else model.key_qpos[home])
    ctrl = np.zeros(model.nu) if home is None else np.array(model.key_ctrl[home])
    columns = [int(model.actuator(name).id) for name in robot.names]
    limits = np.array([servo.position for servo in robot.servos])
    pose = np.clip(ctrl[columns], *limits.T)
    edge = np.minimum(pose - limits[:, 0], limits[:, 1] - pose) < settings.edge * np.ptp(
        limits, axis=1
    )
    pose = np.where(edge, limits.mean(axis=1), pose)
    plan: Plan = excite(robot, pose, settings.motion_s, motions, rng, settings.size)
    commands = np.tile(ctrl, (len(plan.angles), 1))
    commands[:, columns] = plan.angles
    powered = np.ones(commands.shape, bool)
    powered[:, columns] = plan.torque[:, None]
    for column, angle in zip(columns, pose, strict=True):
        qpos[model.jnt_qposadr[model.actuator_trnid[column, 0]]] = angle
    time = np.arange(len(commands)) / robot.rate
    return Recording(time, commands, qpos, np.zeros(model.nv), powered)


def _falls(spec: mujoco.MjSpec, robot: Robot, rng: np.random.Generator, settings: Limits) -> bool:
    """Say whether a robot that is let go in its middle pose leaves it: it would fall over."""
    model = spec.copy().compile()
    rest = record_of(("hold",), model, robot, rng, settings)
    rows = int(settings.fall_s * robot.rate)
    off = np.zeros((rows, model.nu), bool)
    (path,) = trial(
        spec, [rest._replace(time=rest.time[:rows], ctrl=rest.ctrl[:rows], powered=off)]
    )
    places = [
        int(model.jnt_qposadr[model.actuator_trnid[model.actuator(name).id, 0]])
        for name in robot.names
    ]
    return not bool(np.abs(path[:, places] - path[0, places]).max() < settings.fallen)


def _overrides(item: Item, robot: Robot | None, settings: Limits) -> tuple[str, ...]:
    name = "NAME" if robot is None else robot.name
    seconds = f"seconds={settings.motion_s:g}"
    found = [f"robot={name}", f"motions=[{','.join(item.motions)}]", seconds]
    if item.override is not None and robot is not None:
        found.append(item.override(robot))
    return tuple(found)


def _text(
    item: Item,
    members: Sequence[Member],
    separation: float,
    overrides: Sequence[str],
    settings: Limits,
) -> str:
    labels = [member.label for member in members]
    names = f"{', '.join(labels[:-1])} and {labels[-1]}"
    by_script = any("registers" in override for override in overrides)
    first = f"First {item.by_hand}. " if item.by_hand and not by_script else ""
    command = f"python -m sim2real run=record {' '.join(overrides)}"
    text = f"To tell {names} apart, record {item.name}: {first}`{command}`. "
    if separation < settings.apart_min:
        return (
            f"{text}Even there they are only {separation:.1f} times the noise apart: no motion of "
            "the menu separates them on this robot, so either will do in its simulator."
        )
    return f"{text}There they are {separation:.0f} times the noise floor apart."
