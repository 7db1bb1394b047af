"""A hypothesis: at most four changes of the robot, the log or the world, and where they start.

    Hypothesis((candidate, change))         # label, neutral, low, high, steps of all values

A change of the robot is a `Candidate`: an effect at one place, or with one value for all joints of
a kind. A change of the log is a `LogChange`. A change of the world is a `Candidate` whose effect is
in `WORLD`: what is around the robot differs, not what it is made of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from envs.effects import EFFECTS, Effect
from envs.effects.extras import PHASE
from sim2real.diagnosis.inference.candidates import FREE, Candidate
from sim2real.diagnosis.inference.columns import TIME
from sim2real.diagnosis.inference.log_change import LogChange

Member = Candidate | LogChange
Kind = Literal["robot", "log", "world"]
LEAST = 1e-3  # size of a value that no probe changes, at least
SHARES = (-0.2, -0.05, 0.05, 0.2)  # of an edge by which it is moved: coarse and fine steps
WORLD = ("gravity_tilt", "gravity_compensation", "push", "ground_friction", "contact_stiffness")


def get_kind(member: Member) -> Kind:
    """Return what a member changes."""
    if isinstance(member, LogChange):
        return "log" if member.effect is None else "robot"
    return "world" if member.name in WORLD else "robot"


def get_effect(member: Member) -> Effect | None:
    """Return the effect that every verb knows a member by; None where there is none."""
    return member.effect if member.effect is not None and member.effect.name in EFFECTS else None


def get_size(member: Member) -> np.ndarray:
    """Return the size of each value of a member at its largest probe, (P,)."""
    changes = np.where(member.neutral >= FREE, member.probes, member.probes - member.neutral)
    size = np.abs(changes).max(axis=0)
    return np.where(size > 0, size, np.maximum(np.abs(member.probes).max(axis=0), LEAST))


def _bounds_of(member: Member, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Return what a member's values can physically be, (P,) each; see `Hypothesis.bounded`.

    The ends of a further value's range are laws of their own, as a dead zone beyond which the whole
    error counts: it may lie there.
    """
    if isinstance(member, LogChange):
        return member.low, member.high
    far, limit = reach * get_size(member), member.neutral >= FREE
    further = np.arange(len(far)) >= len(far) - len(member.effect.free)
    low = np.where(limit, member.low, np.maximum(member.low, member.neutral - far))
    high = np.where(limit, member.high, np.minimum(member.high, member.neutral + far))
    return np.where(further, -np.inf, low), np.where(further, np.inf, high)


@dataclass(frozen=True)
class Hypothesis:
    """Members, those that change the log last."""

    members: tuple[Member, ...]

    @staticmethod
    def of(members: Sequence[Member]) -> Hypothesis:
        """Return members in the order in which they act: in the simulation, then in the log."""
        return Hypothesis(tuple(sorted(members, key=lambda m: isinstance(m, LogChange))))

    @property
    def effects(self) -> tuple[Candidate, ...]:
        """What differs in the simulation."""
        return tuple(p for m in self.members if isinstance(m, Candidate) for p in m.parts)

    @property
    def changes(self) -> tuple[LogChange, ...]:
        """What differs in the log."""
        return tuple(m for m in self.members if isinstance(m, LogChange))

    @property
    def needs_short_steps(self) -> bool:
        """Whether forces change fast, by a spring, play or edge, or commands are moved."""
        timed = any(TIME in change.columns for change in self.changes)
        return timed or any(m.adds_structure or m.effect.jumps for m in self.effects)

    @property
    def mended(self) -> frozenset[str]:
        """The labels of these."""
        return frozenset(change.label for change in self.changes)

    @property
    def burden(self) -> tuple[int, int]:
        """The numbers of its free values and of its mistakes in the log; fewer are simpler."""
        return int(self.smooth.sum()), sum(get_kind(member) == "log" for member in self.members)

    @property
    def label(self) -> str:
        """What tells it apart, whatever the order of its members."""
        return " + ".join(sorted(m.label for m in self.members)) or "as given"

    @cached_property
    def columns(self) -> list[slice]:
        """Where each member's values are in a row of them."""
        ends = np.cumsum([len(m.neutral) for m in self.members], dtype=int)
        return [slice(e - len(m.neutral), e) for m, e in zip(self.members, ends, strict=True)]

    @property
    def parts(self) -> list[tuple[Member, slice, int]]:
        """What its members consist of, where the values of each are, and of which member it is."""
        found: list[tuple[Member, slice, int]] = []
        for place, (member, column) in enumerate(zip(self.members, self.columns, strict=True)):
            start = column.start
            for part in member.parts:
                found.append((part, slice(start, start := start + len(part.neutral)), place))
        return found

    @cached_property
    def low(self) -> np.ndarray:
        """Smallest values, (P,)."""
        return np.concatenate([np.zeros(0), *(m.low for m in self.members)])

    @cached_property
    def high(self) -> np.ndarray:
        """Largest values, (P,)."""
        return np.concatenate([np.zeros(0), *(m.high for m in self.members)])

    def bounded(self, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the bounds of what values can physically be, (P,) each.

        Those that each member declares; of the robot and the world also so many times the largest
        probe, which an effect takes from the robot's own sizes.
        """
        pairs = [_bounds_of(member, reach) for member in (*self.effects, *self.changes)]
        none = np.zeros(0)
        return (
            np.concatenate([none, *(low for low, _ in pairs)]),
            np.concatenate([none, *(high for _, high in pairs)]),
        )

    @cached_property
    def size(self) -> np.ndarray:
        """Size of each value at its largest probe, (P,)."""
        return np.concatenate([np.zeros(0), *(get_size(m) for m in self.members)])

    @cached_property
    def waves(self) -> list[tuple[int, int]]:
        """Where amplitude and phase of each wave are among the values."""
        found = []
        for member, column, _ in self.parts:
            free = member.effect.free if isinstance(member, Candidate) else ()
            if PHASE in free:
                found.append((column.start, column.stop - len(free) + free.index(PHASE)))
        return found

    def to_linear(self, values: np.ndarray) -> np.ndarray:
        """Return the coordinates (..., P) in which values (..., P) are fitted.

        Those of a wave are its cosine and its sine part: it is linear in them, and they say what it
        is at amplitude 0 too, where its phase says nothing. The others are the values.
        """
        linear = values.copy()
        for amplitude, phase in self.waves:
            size, turn = values[..., amplitude], values[..., phase]
            linear[..., amplitude], linear[..., phase] = size * np.cos(turn), size * np.sin(turn)
        return linear

    def from_linear(self, linear: np.ndarray) -> np.ndarray:
        """Return the values (..., P), within their bounds, at coordinates of `to_linear`."""
        values = linear.copy()
        for amplitude, phase in self.waves:
            cosine, sine = linear[..., amplitude], linear[..., phase]
            values[..., amplitude] = np.hypot(cosine, sine)
            values[..., phase] = np.arctan2(sine, cosine)
        return self.clip(values)

    @cached_property
    def linear_size(self) -> np.ndarray:
        """Size of each coordinate of `to_linear` at its largest probe, (P,)."""
        size = self.size.copy()
        for amplitude, phase in self.waves:
            size[phase] = size[amplitude]
        return size

    @cached_property
    def smooth(self) -> np.ndarray:
        """Which values move in steps as small as one likes, (P,) bool.

        A whole number does not, nor does what shapes a force that jumps: it is 0 or 1.
        """
        smooth = np.ones(len(self.low), bool)
        for part, column, _ in self.parts:
            if isinstance(part, LogChange):
                smooth[column] = not part.whole
            elif part.effect.jumps:
                smooth[column.stop - len(part.effect.free) : column.stop] = False
        return smooth

    def list_near(self, values: np.ndarray) -> list[np.ndarray]:
        """Return values (..., P) near others that no slope leads to, each apart.

        Whole numbers move by one. Where a force jumps at an edge, replays are too rough for slopes:
        the edge is tried nearby.
        """
        whole = [(place, step) for place in np.flatnonzero(~self.smooth) for step in (-1.0, 1.0)]
        rough = [
            (column.start, share * values[..., column.start])
            for part, column, _ in self.parts
            if isinstance(part, Candidate) and part.effect.jumps
            for share in SHARES
        ]
        found = []
        for place, step in [*whole, *rough]:
            other = values.copy()
            other[..., place] += step
            found.append(self.clip(other))
        return [other for other in found if (other != values).any()]

    def crosses(self, values: np.ndarray, others: np.ndarray) -> np.ndarray:
        """Return which of others, (2, P), put readings into other rows than values (2, P) do.

        Windows then start elsewhere, so that errors jump.
        """
        found = np.zeros(values.shape, bool)
        for member, column in zip(self.members, self.columns, strict=True):
            if isinstance(member, LogChange):
                pairs = zip(values[:, column], others[:, column], strict=True)
                found[:, column] = [
                    [round(member.late(a)) != round(member.late(b))] for a, b in pairs
                ]
        return found

    def clip(self, values: np.ndarray) -> np.ndarray:
        """Return values (..., P) within their bounds."""
        return np.clip(values, self.low, self.high)

    def without(self, place: int) -> Hypothesis:
        """Return the hypothesis without one of its members."""
        return Hypothesis(self.members[:place] + self.members[place + 1 :])


NONE = Hypothesis(())  # the model as given
