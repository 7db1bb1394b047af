"""Effects that can imitate another one, and are withheld together with it.

    rivals = withheld(robot, truth, log, floor)     # ("payload", "center_of_mass")

Each other effect is fitted alone, at every place where it could act alike: the same joint, the
bodies that it moves or that carry it, the whole robot. It is a rival if the gap that it leaves is
at most twice the floor. The fit is a plain search by the cross-entropy method (Rubinstein 1999), a
population of simulations at a time: slow, but it needs no slope and shares nothing with the
diagnosis that it helps to check.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from envs.effects import EFFECTS as VOCABULARY
from envs.effects import Effect, Sizes, make
from envs.errors import EnvsError
from envs.plant import Plant
from envs.replay import DivergedError, switchable
from hardware.config import Robot
from hardware.log import Log
from sim2real.exam.hiding import EFFECTS, moved, place_of, scales, value_of
from sim2real.exam.measure import residuals

RIVAL_FLOORS = 2.0  # floors: what a rival may leave
ROWS, ROUNDS, ELITE = 16, 4, 4
HOPELESS = 0.85  # of the gap that the best of the first round leaves: no more rounds then


class Fit(NamedTuple):
    """The best that one effect does."""

    values: np.ndarray  # (P,)
    left: float  # RMS over joints and rows [rad]


def withheld(
    robot: Robot, truth: Mapping[str, Any], log: Log, floor: float, seed: int
) -> tuple[str, ...]:
    """Return the effects that refit a hidden one to within twice the floor.

    Args:
        robot: a robot from `exam_robot`.
        truth: the hidden effect: its name, `where` and `joint`.
        log: a recording of the robot that hides it; a short one will do, since whatever fits all
            of a robot's motions fits this one.
        floor: what noise leaves [rad].
        seed: the seed of the fits' starting points.
    """
    spec = mujoco.MjSpec.from_file(str(robot.model))
    rng, found = np.random.default_rng(seed), []
    for name in EFFECTS:
        if name == truth["effect"]:
            continue
        others = rivals(robot, name, truth)
        tries = (fit(robot, spec, one, log, RIVAL_FLOORS * floor, rng) for one in others)
        if any(one is not None and one.left <= RIVAL_FLOORS * floor for one in tries):
            found.append(name)
    return tuple(found)


def rivals(robot: Robot, name: str, truth: Mapping[str, Any]) -> list[Effect]:
    """Return an effect at every place where it could pass for the hidden one."""
    joint = truth["joint"]
    kind, servo = VOCABULARY[name], robot.servos[0]
    volts, constant = robot.supply_of(servo).voltage, servo.type.torque_constant
    facts = {"voltage": volts, "torque_constant": constant}
    extra: dict[str, Any] = {e.name: facts[e.name] for e in kind.extras if e.default is None}
    if free := tuple(e.name for e in kind.extras if e.typical is not None):
        extra["free"] = free
    match place_of(name):
        case "robot":
            spots: list[str | None] = [None]
        case "joint":
            spots = [joint]
        case "body":
            chain = _chain(robot.model, moved(robot)[joint])
            spots = [*sorted(chain & set(moved(robot).values()))]
    return [
        make(name, where=spot, side=side, **extra)
        for spot in spots
        for side in kind.sides or (None,)
    ]


def _chain(path: Path, body: str) -> set[str]:
    """Return a body, those that carry it and those that it carries."""
    model = mujoco.MjModel.from_xml_path(str(path))
    start = model.body(body).id
    found = set()
    for other in range(1, model.nbody):
        for upper, lower in ((start, other), (other, start)):
            while lower > upper:
                lower = int(model.body_parentid[lower])
            if lower == upper:
                found.add(model.body(other).name)
    return found


def fit(
    robot: Robot,
    spec: mujoco.MjSpec,
    effect: Effect,
    log: Log,
    enough: float,
    rng: np.random.Generator,
) -> Fit | None:
    """Fit one effect to a log, until it leaves no more than `enough` [rad].

    None if the robot cannot have the effect.
    """
    plant = with_effect(spec, effect)
    if plant is None:
        return None
    joint = effect.where if effect.place in ("joint", "actuator") else None
    sizes = EFFECTS[effect.name]
    return search(plant, effect, sizes, scales(robot, joint)[sizes.unit], log, enough, rng)


def with_effect(spec: mujoco.MjSpec, effect: Effect) -> Plant | None:
    """Return a model's simulations with an effect, or None if it cannot have it."""
    try:
        return Plant(switchable(spec), [effect], num_rows=ROWS)
    except EnvsError:
        return None


def search(
    plant: Plant,
    effect: Effect,
    sizes: Sizes,
    unit: float,
    log: Log,
    enough: float,
    rng: np.random.Generator,
) -> Fit:
    """Fit one effect to a log, as `fit` does, within given sizes.

    Args:
        plant: the nominal model's simulations with the effect.
        effect: the effect, at its place.
        sizes: which sizes, and how they become values.
        unit: what a size multiplies.
        log: a recording.
        enough: what may be left [rad].
        rng: of where the search looks.
    """
    size = plant.space.size
    mean, spread, best = np.zeros(size), np.full(size, np.inf), Fit(np.zeros(size), np.inf)
    before = _left(plant, plant.space.points(ROWS), log)[0]
    for _ in range(ROUNDS):
        wild = rng.uniform(-1, 1, (ROWS, size))
        near = np.clip(mean + np.where(np.isfinite(spread), spread, 0) * wild, -1, 1)
        points = np.where(np.isfinite(spread), near, wild)  # (N, P) in [-1, 1]
        values = np.array([_values(effect, sizes, unit, point) for point in points])
        values = np.clip(values, plant.space.low, plant.space.high)
        left = _left(plant, values, log)
        order = np.argsort(left)
        if left[order[0]] < best.left:
            best = Fit(values[order[0]], float(left[order[0]]))
        if best.left <= enough or best.left > HOPELESS * before:
            break
        elite = points[order[:ELITE]]
        mean, spread = elite[0], np.maximum(2 * np.ptp(elite, axis=0), 0.02)
    return best


def _values(effect: Effect, span: Sizes, unit: float, point: np.ndarray) -> list[float]:
    """Return the parameters at a point of [-1, 1]^P: sizes go from nothing outwards."""
    first = float(point[0])
    if span.form == "tilt":
        own = [span.high * float(x) for x in point[:2]]
    else:
        low, high = math.log(span.low), math.log(span.high)
        size = math.exp(low + abs(first) * (high - low))
        own = [value_of(span.form, size, unit, first)]
    free = [e.typical for e in effect.extras if e.typical is not None]
    further = zip(free, point[len(own) :], strict=True)
    return own + [low + (float(x) + 1) / 2 * (high - low) for (low, high), x in further]


def _left(plant: Plant, values: np.ndarray, log: Log) -> np.ndarray:
    """Return the gap that each row's values (N, P) leave, (N,); inf where they diverge."""
    values, rows = values.copy(), np.arange(plant.num_rows)
    lost = np.zeros(plant.num_rows, bool)
    while True:
        plant.set_params(rows, values)
        try:
            errors = residuals(log, plant)
        except DivergedError as error:
            lost[error.row] = True
            keep = np.flatnonzero(~lost)
            if not len(keep):
                return np.full(plant.num_rows, np.inf)
            values[error.row] = values[keep[0]]
            continue
        left = np.sqrt(np.mean(errors**2, axis=(1, 2)))
        return np.where(lost, np.inf, left)
