"""What could be missing: every effect that this robot can have, at every place.

    for candidate in candidates(data):
        candidate.effect.label(), candidate.probes      # (K, P) values to look at first

The vocabulary is that of `envs.effects`; an effect that a user registers is a candidate too. What
closes no gap is none (`Effect.visible_in_replay`): noise, quantization, the filter of the speed
and lost packets are read off the log.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from envs.effects import EFFECTS, Effect, RobotScale, make
from envs.effects.base import PLAIN, RULES
from envs.errors import EnvsError, did_you_mean
from envs.plant import Fixed
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.lean import undrawn
from sim2real.diagnosis.inference.probes import probes_of, robot_scale
from sim2real.runs.errors import Sim2RealError

FREE = 1e5  # a limit of this size is none
TYPICAL = 0.3  # a typical change, of the largest probe
NUDGE = 0.06  # finite difference, of a value's distance from neutral
SMALLEST = 1e-3  # scale below which what acts as it shrinks grows no further
SAME = 1e-12  # a probe this close to neutral changes nothing


@dataclass(frozen=True)
class Candidate:
    """An effect at a place, and where a fit of it starts."""

    effect: Effect
    joint: str | None  # whose motion shows it first; None for the robot
    probes: np.ndarray  # (K, P) values of its parameters that span what may be
    neutral: np.ndarray  # (P,) values at which it is absent
    low: np.ndarray  # (P,) smallest values
    high: np.ndarray  # (P,) largest values
    group: str  # candidates of one group can be simulated in one batch
    joints: tuple[str, ...] = ()  # whose motion it changes: its own; of a body all that carry it

    @property
    def name(self) -> str:
        """The effect's standard name."""
        return self.effect.name

    @property
    def unit(self) -> str:
        """The unit of its first value."""
        return self.effect.unit

    @property
    def label(self) -> str:
        """Law, and what is fitted later and free: what tells candidates apart."""
        later = [e.name for e in self.effect.extras if e.later and e.name in self.effect.free]
        return f"{self.law} ({', '.join(later)})" if later else self.law

    @property
    def law(self) -> str:
        """Name, place and side: a robot has each once."""
        variant = self.effect.variant
        return f"{self.effect.label()} ({variant})" if variant else self.effect.label()

    @property
    def place(self) -> str | None:
        """What a report calls its place: a body effect's is the joint that moves the body.

        A free base, which no hinge or slide moves, goes by its own name.
        """
        return (self.joint if self.effect.place == "body" else None) or self.effect.where

    def elaborated(self) -> Candidate | None:
        """Return it with what is fitted later free as well (`Extra.later`), its last values.

        None where there is no such extra.
        """
        free = self.effect.free
        later = [e for e in self.effect.extras if e.later and e.fit and e.name not in free]
        if not later:
            return None
        effect = copy(self.effect)
        effect.free = (*free, *(e.name for e in later))
        absent = [effect.extra[e.name] for e in later]
        low, high = np.transpose([e.fit for e in later if e.fit])
        return replace(
            self,
            effect=effect,
            probes=np.column_stack([self.probes, np.tile(absent, (len(self.probes), 1))]),
            neutral=np.append(self.neutral, absent),
            low=np.append(self.low, low),
            high=np.append(self.high, high),
            group=effect.batch(),
        )

    @property
    def parts(self) -> tuple[Candidate, ...]:
        """What is simulated, each with values of its own."""
        return (self,)

    @property
    def shared(self) -> bool:
        """Whether one value holds for all joints or actuators."""
        return self.effect.where is None and self.effect.place in ("joint", "actuator")

    @property
    def adds_structure(self) -> bool:
        """Whether it adds bodies or joints to the model."""
        return self.group not in (PLAIN, RULES)

    @property
    def step(self) -> np.ndarray:
        """The size of a typical change of each parameter, (P,)."""
        changes = np.where(self.neutral >= FREE, self.probes, self.probes - self.neutral)
        size = np.abs(changes).max(axis=0)  # 0 of what every probe leaves as it is, such as a count
        return TYPICAL * np.where(size > 0, size, np.abs(self.probes).max(axis=0))

    def towards(self, point: np.ndarray, scale: float) -> np.ndarray:
        """Return the point at which the effect is `scale` times as large as at `point`, (P,).

        Phases and the like stay. What acts more as it shrinks (a limit, a factor below 1) shrinks
        in proportion where a straight line would take it past zero.
        """
        grown = self.neutral + scale * (point - self.neutral)
        shrunk = point / np.maximum(scale, SMALLEST)
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
                f"exclude: unknown effect {name!r}{did_you_mean(name, EFFECTS)};"
                f" choose one of: {known}"
            )


def candidates(data: Data, fixed: Sequence[Fixed] = ()) -> list[Candidate]:
    """Return every effect that the models of some logs can have.

    Of an effect that is fixed, which is in the models already, more of the same is a candidate
    where two of them add up, and none where they would get into each other's way.
    """
    scale, spec = robot_scale(data, fixed), undrawn(data.specs[0])
    found = []
    for name, effect in EFFECTS.items():
        if effect.visible_in_replay:
            for place, more in itertools.product(effect.places(scale), effect.variants(scale)):
                candidate = candidate_of(name, {"where": place, **more}, spec, scale)
                if candidate is not None and not _taken(candidate.effect, fixed):
                    found.append(candidate)
    return found


def get_nudges(members: Sequence[Candidate], values: np.ndarray) -> np.ndarray:
    """Return a step of each value for finite differences, (P,), towards where it may go."""
    neutral = np.concatenate([member.neutral for member in members])
    high = np.concatenate([member.high for member in members])
    typical = np.concatenate([member.step for member in members])
    size = np.abs(np.where(neutral >= FREE, values, values - neutral))
    step = NUDGE * np.maximum(size, TYPICAL * typical)
    return np.where(values + step > high, -step, step)


def in_the_way(one: Effect, other: Effect) -> bool:
    """Return whether two effects of one name meet at a joint that can have only one of them.

    An effect without a place is at all of them: a joint bends about one spring.
    """
    meet = one.where == other.where or None in (one.where, other.where)
    return one.name == other.name and meet and not one.composes


def _taken(effect: Effect, fixed: Sequence[Fixed]) -> bool:
    """Return whether an effect is fixed at this place: it cannot be combined with itself."""
    there = any((one.name, one.where) == (effect.name, effect.where) for one, _ in fixed)
    return (there and effect.how == "set") or any(in_the_way(one, effect) for one, _ in fixed)


def candidate_of(
    name: str, arguments: dict[str, Any], spec: mujoco.MjSpec, scale: RobotScale
) -> Candidate | None:
    """Return an effect with some arguments as a candidate; None where the robot cannot have it."""
    try:
        effect = make(name, **arguments)
        edited = spec.copy()
        effect.edit(edited)
        parameters = effect.parameters(edited.compile() if effect.edits else scale.model)
    except EnvsError:
        return None
    neutral = np.array([p.neutral for p in parameters])
    low, high = np.array([p.low for p in parameters]), np.array([p.high for p in parameters])
    fits = {extra.name: extra.fit for extra in effect.extras}
    for place, name in enumerate(effect.free, len(neutral) - len(effect.free)):
        low[place], high[place] = fits[name] or (low[place], high[place])
    probes = probes_of(effect, neutral, scale)
    probes = np.clip(probes, low, high)
    probes = probes[(np.abs(probes - neutral) > SAME).any(axis=1)]
    if not len(probes):
        return None
    joint = _joint(effect, scale)
    shown = (joint,) if joint else ()
    if effect.place == "body":
        shown = scale.carriers(str(effect.where))
    return Candidate(effect, joint, probes, neutral, low, high, effect.batch(), shown)


def _joint(effect: Effect, scale: RobotScale) -> str | None:
    if effect.where is None:
        return None
    if effect.place == "joint":
        return effect.where
    if effect.place == "actuator":
        return scale.driven.get(effect.where)
    return next(iter(scale.carriers(effect.where)), None) if effect.place == "body" else None
