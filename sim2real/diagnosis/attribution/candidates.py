"""What could be missing: every effect that this robot can have, at every place.

    for candidate in candidates(data, exclude=("backlash",)):
        candidate.effect.label(), candidate.probes      # (K, P) values to look at first

The vocabulary is that of `envs.effects`; an effect that a user registers is a candidate too. What
closes no gap is none (`Effect.closes_gaps`): noise, quantization, the filter of the speed and lost
packets are read off the log.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import mujoco
import numpy as np

from envs.effects import EFFECTS, Effect, RobotScale, make
from envs.errors import EnvsError, did_you_mean
from envs.plant import Fixed
from sim2real.diagnosis.attribution.probes import probes_of, robot_scale
from sim2real.diagnosis.data.dataset import Data
from sim2real.runs.errors import Sim2RealError

FREE = 1e5  # a limit of this size is none


@dataclass(frozen=True)
class Candidate:
    """An effect at a place, and where a fit of it starts.

    Args:
        effect: the effect.
        joint: the joint whose motion shows it first; None for the robot.
        probes: values of its parameters that span what may be, (K, P).
        neutral: values at which it is absent, (P,).
        low: smallest values, (P,).
        high: largest values, (P,).
        group: candidates of one group can be simulated in one batch.
        shown: joints whose motion it changes: its own, and for a body all that carry it.
    """

    effect: Effect
    joint: str | None
    probes: np.ndarray
    neutral: np.ndarray
    low: np.ndarray
    high: np.ndarray
    group: str
    shown: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The effect's standard name."""
        return self.effect.name

    @property
    def label(self) -> str:
        """Name, place and side: what tells candidates apart."""
        variant = self.effect.variant
        return f"{self.effect.label()} ({variant})" if variant else self.effect.label()

    @property
    def place(self) -> str | None:
        """What a report calls its place: a body effect's is the joint that moves the body."""
        return self.joint if self.effect.place == "body" else self.effect.where

    @property
    def step(self) -> np.ndarray:
        """The size of a typical change of each parameter, (P,)."""
        changes = np.where(self.neutral >= FREE, self.probes, self.probes - self.neutral)
        return 0.3 * np.abs(changes).max(axis=0)

    def towards(self, point: np.ndarray, scale: float) -> np.ndarray:
        """Return the point at which the effect is `scale` times as large as at `point`, (P,).

        Phases and the like stay. What acts more as it shrinks (a limit, a factor below 1) shrinks
        in proportion where a straight line would take it past zero.
        """
        grown = self.neutral + scale * (point - self.neutral)
        shrunk = point / np.maximum(scale, 1e-3)
        shrinks = (self.low >= 0.0) & (point < self.neutral) & (scale > 1.0)
        grown = np.where(shrinks, np.maximum(grown, shrunk), grown)
        grown = np.where(self.neutral >= FREE, shrunk, grown)
        free = len(self.effect.free)
        kept = np.arange(len(point)) >= len(point) - free
        return np.clip(np.where(kept, point, grown), self.low, self.high)


def check_names(exclude: Sequence[str]) -> None:
    """Raise Sim2RealError for the name of an effect that does not exist."""
    for name in exclude:
        if name not in EFFECTS:
            known = ", ".join(sorted(EFFECTS))
            raise Sim2RealError(
                f"exclude: there is no effect {name!r}{did_you_mean(name, EFFECTS)};"
                f" there are: {known}"
            )


def candidates(
    data: Data, exclude: Sequence[str] = (), fixed: Sequence[Fixed] = ()
) -> list[Candidate]:
    """Return every effect that the models can have, but those excluded.

    Args:
        data: the logs and their models.
        exclude: names of effects to leave out.
        fixed: effects that are in the model already; more of the same is a candidate where two of
            them add up, and no candidate where they would get into each other's way.

    Raises:
        Sim2RealError: an unknown name to exclude.
    """
    check_names(exclude)
    robot = _Robot(data, robot_scale(data, fixed))
    found = []
    for name, effect in EFFECTS.items():
        if effect.closes_gaps and name not in exclude:
            for arguments in _arguments(effect, robot):
                candidate = _make(name, arguments, robot)
                if candidate is not None and not _taken(candidate.effect, fixed):
                    found.append(candidate)
    return found


class _Robot(NamedTuple):
    """The logs of a robot and its sizes."""

    data: Data
    scale: RobotScale

    @property
    def joints(self) -> list[str]:
        """The compared joints."""
        return [joint.name for joint in self.data.joints]


def _taken(effect: Effect, fixed: Sequence[Fixed]) -> bool:
    """Return whether an effect is fixed at this place, and cannot stand beside itself."""
    there = any((one.name, one.where) == (effect.name, effect.where) for one, _ in fixed)
    return there and (not effect.composes or effect.how == "set")


def _arguments(effect: type[Effect], robot: _Robot) -> Iterator[dict[str, Any]]:
    """Yield the arguments of an effect at each place of the robot."""
    for place, more in itertools.product(_places(effect, robot), effect.variants(robot.scale)):
        yield {"where": place, **more}


def _places(effect: type[Effect], robot: _Robot) -> list[str | None]:
    """Return where on the robot an effect may be; None for all of it."""
    if effect.place == "joint":
        return [*robot.joints]
    if effect.place == "actuator":
        return [*robot.scale.actuators]
    if effect.place == "body":
        model = robot.scale.model
        bodies = [model.body(i).name for i in range(1, model.nbody)]
        return [body for body in bodies if _moving_joint(robot, body) is not None]
    return [None]


def _make(name: str, arguments: dict[str, Any], robot: _Robot) -> Candidate | None:
    """Return the candidate, or None where the robot cannot have it."""
    try:
        effect = make(name, **arguments)
        spec = robot.data.specs[0].copy()
        effect.edit(spec)
        parameters = effect.parameters(spec.compile() if _edits(effect) else robot.scale.model)
    except EnvsError:
        return None
    neutral = np.array([p.neutral for p in parameters])
    low, high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
    fits = {extra.name: extra.fit for extra in effect.extras}
    for place, name in enumerate(effect.free, len(neutral) - len(effect.free)):
        low[place], high[place] = fits[name] or (low[place], high[place])
    probes = probes_of(effect, neutral, robot.scale)
    probes = np.clip(probes, low, high)
    probes = probes[(np.abs(probes - neutral) > 1e-12).any(axis=1)]
    if not len(probes):
        return None
    joint = _joint(effect, robot)
    shown = (joint,) if joint else ()
    if effect.place == "body":
        shown = _carriers(robot, str(effect.where))
    return Candidate(effect, joint, probes, neutral, low, high, effect.batch(), shown)


def _edits(effect: Effect) -> bool:
    return type(effect).edit is not Effect.edit


def _joint(effect: Effect, robot: _Robot) -> str | None:
    if effect.where is None:
        return None
    if effect.place == "joint":
        return effect.where
    if effect.place == "actuator":
        return robot.scale.driven.get(effect.where)
    return _moving_joint(robot, effect.where) if effect.place == "body" else None


def _moving_joint(robot: _Robot, body: str) -> str | None:
    """Return the compared joint nearest above a body."""
    return next(iter(_carriers(robot, body)), None)


def _carriers(robot: _Robot, body: str) -> tuple[str, ...]:
    """Return the compared joints that carry a body, the nearest first."""
    model, found = robot.scale.model, []
    index = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body))
    while index > 0:
        first, count = int(model.body_jntadr[index]), int(model.body_jntnum[index])
        names = [model.joint(j).name for j in range(first, first + count)]
        found += [n for n in reversed(names) if n in robot.joints]
        index = int(model.body_parentid[index])
    return tuple(found)
