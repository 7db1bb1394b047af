"""What could be missing: every effect that this robot can have, at every place.

    for candidate in candidates(data, exclude=("backlash",)):
        candidate.effect.label(), candidate.probes      # (K, P) values to look at first

The vocabulary is that of `envs.effects`; an effect that a user registers is a candidate too. Noise,
quantization, the filter of the speed and lost packets are not: they are read off the log, and
simulating the same noise closes no gap.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from envs.effects import EFFECTS, Effect, make
from envs.effects.base import FieldEffect
from envs.effects.structure import SeriesEffect
from envs.errors import EnvsError, did_you_mean
from envs.plant import Fixed
from sim2real.diagnosis.attribution.probes import Robot, probes_of
from sim2real.diagnosis.data.dataset import Data
from sim2real.runs.errors import Sim2RealError

MEASURED = ("sensor_noise", "quantization", "velocity_filter", "packet_loss")
LOOKS = ".appearance"  # the module of effects that only a camera sees
PLAIN = (
    "position_gain",
    "derivative_gain",
    "supply_voltage",
    "motor_strength",
    "command_delay",
    "observation_delay",
    "gravity_tilt",
)
PLAIN += ("center_of_mass", "payload", "contact_stiffness", "encoder_offset")  # in one batch
FREE = 1e5  # a limit of this size is none
# Further scalars that are fitted too, and between what. Dry friction that has not fallen at a few
# rad/s is Coulomb's.
FITTED: dict[str, dict[str, tuple[float, float]]] = {
    "cogging": {"count": (0.0, 1e4), "phase": (-2 * np.pi, 2 * np.pi)},
    "joint_compliance": {"damping": (0.0, 1e3)},
    "load_dependent_friction": {"external": (0.0, 1.0)},
    "stribeck_friction": {"speed": (0.05, 3.0)},
}


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
        side = f" ({self.effect.side} side)" if self.effect.side else ""
        logged = " (log only)" if self.effect.extra.get("servo") == 0.0 else ""
        return f"{self.effect.label()}{side}{logged}"

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
    robot = Robot(data, fixed)
    found = []
    for name in EFFECTS:
        shown = EFFECTS[name].__module__.endswith(LOOKS)
        if name not in MEASURED and name not in exclude and not shown:
            for arguments in _places(name, robot):
                candidate = _make(name, arguments, robot)
                if candidate is not None and not _taken(candidate.effect, fixed):
                    found.append(candidate)
    return found


def _taken(effect: Effect, fixed: Sequence[Fixed]) -> bool:
    """Return whether an effect is fixed at this place, and cannot stand beside itself."""
    there = any((one.name, one.where) == (effect.name, effect.where) for one, _ in fixed)
    return there and (not effect.composes or effect.how == "set")


def _places(name: str, robot: Robot) -> Iterator[dict[str, Any]]:
    """Yield the arguments of an effect at each place of the robot."""
    effect = EFFECTS[name]
    sides: list[dict[str, Any]] = [{"side": side} for side in effect.sides] or [{}]
    if effect.place == "joint":
        places: list[str | None] = [*robot.joints]
    elif effect.place == "actuator":
        places = [*robot.actuators]
    elif effect.place == "body":
        places = [robot.model.body(i).name for i in range(1, robot.model.nbody)]
        places = [p for p in places if _moving_joint(robot, str(p)) is not None]
    else:
        places = [None]
    more: list[dict[str, Any]] = [{}]
    if name == "encoder_offset":
        more = [{"servo": 1.0}, {"servo": 0.0}]
    elif name in FITTED:
        more = [{"free": tuple(FITTED[name])}]
    elif name == "supply_sag":
        constant = robot.torque_constant()
        if constant is None:
            return
        more = [{"voltage": constant[0], "torque_constant": constant[1]}]
    elif any(extra.default is None for extra in effect.extras):
        more = []
    for place, side, extra in itertools.product(places, sides, more):
        yield {"where": place, **side, **extra}


def _make(name: str, arguments: dict[str, Any], robot: Robot) -> Candidate | None:
    """Return the candidate, or None where the robot cannot have it."""
    try:
        effect = make(name, **arguments)
        spec = robot.data.specs[0].copy()
        effect.edit(spec)
        parameters = effect.parameters(spec.compile() if _edits(effect) else robot.model)
    except EnvsError:
        return None
    neutral = np.array([p.neutral for p in parameters])
    low, high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
    for place, name in enumerate(effect.free, len(neutral) - len(effect.free)):
        low[place], high[place] = FITTED[effect.name][name]
    probes = probes_of(effect, neutral, robot)
    probes = np.clip(probes, low, high)
    probes = probes[(np.abs(probes - neutral) > 1e-12).any(axis=1)]
    if not len(probes):
        return None
    joint = _joint(effect, robot)
    shown = (joint,) if joint else ()
    if effect.place == "body":
        shown = _carriers(robot, str(effect.where))
    return Candidate(effect, joint, probes, neutral, low, high, _group(effect), shown)


def _edits(effect: Effect) -> bool:
    return type(effect).edit is not Effect.edit


def _group(effect: Effect) -> str:
    if effect.extra.get("servo") == 0.0:
        return "log offset"
    if isinstance(effect, FieldEffect) or effect.name in PLAIN:
        return "plain"
    if isinstance(effect, SeriesEffect):
        return f"{effect.label()} {effect.side}"
    return "rules" if type(effect).__module__.startswith("envs.") else effect.name


def _joint(effect: Effect, robot: Robot) -> str | None:
    if effect.where is None:
        return None
    if effect.place == "joint":
        return effect.where
    if effect.place == "actuator":
        return robot.driven.get(effect.where)
    return _moving_joint(robot, effect.where) if effect.place == "body" else None


def _moving_joint(robot: Robot, body: str) -> str | None:
    """Return the compared joint nearest above a body."""
    return next(iter(_carriers(robot, body)), None)


def _carriers(robot: Robot, body: str) -> tuple[str, ...]:
    """Return the compared joints that carry a body, the nearest first."""
    model, found = robot.model, []
    index = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body))
    while index > 0:
        first, count = int(model.body_jntadr[index]), int(model.body_jntnum[index])
        names = [model.joint(j).name for j in range(first, first + count)]
        found += [n for n in reversed(names) if n in robot.joints]
        index = int(model.body_parentid[index])
    return tuple(found)
