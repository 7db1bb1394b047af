"""How far apart explanations are in motions that nobody recorded yet, once they refit.

    asked = Asked(spec, noise, past, fixed)
    separation(members, motions, asked)         # (K, P) noise floors, after one linear step each
    refitted(members, motion, asked)            # (P,) of one motion, after exact refits

One explanation takes the robot's place, another follows it as well as it can: its values move to
where they fit the new motion and the recordings so far. What is left is what the new recording
would show of it (Atkinson and Fedorov 1975, T-optimal designs), root mean square over time, summed
over joints. Nobody knows which explanation is the robot, so of each of the P pairs of explanations
(`pairs`) the worse direction counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.optimize import least_squares

from envs.effects import merge_effects
from envs.plant import Fixed
from envs.replay import Recording
from sim2real.diagnosis.data.trial import trial

CHANGE = 0.05  # of a value's distance from neutral: what a sensitivity is taken over
TURNS = 6  # simulations of a refit, but for its slopes: one of one to four values has settled then


class Member(NamedTuple):
    """One of the explanations that the logs leave open: a label and effects with their values."""

    label: str
    fixed: tuple[Fixed, ...]


class Asked(NamedTuple):
    """What motions are simulated with.

    Args:
        spec: the model.
        noise: of one reading by column of the state, {column of qpos: rad or m}.
        past: recordings that the explanations follow already.
        fixed: effects that the robot has in any case.
        changed: the model in new motions, where something is changed for them; None: as it was.
    """

    spec: mujoco.MjSpec
    noise: dict[int, float]
    past: tuple[Recording, ...] = ()
    fixed: tuple[Fixed, ...] = ()
    changed: mujoco.MjSpec | None = None


def pairs(members: Sequence[Member]) -> list[tuple[Member, Member]]:
    """Return the P pairs of explanations, in the order of `separation` and `refitted`."""
    return list(combinations(members, 2))


def separation(members: Sequence[Member], motions: Sequence[Recording], asked: Asked) -> np.ndarray:
    """Return how far each pair of members is apart in each motion, (K, P) noise floors.

    Refits are one linear step. NaN where a member cannot follow the motion.
    """
    views = combinations([_View.of(member, motions, asked) for member in members], 2)
    found = [
        [
            np.minimum(one.left(other, k, len(motion.time)), other.left(one, k, len(motion.time)))
            for k, motion in enumerate(motions)
        ]
        for one, other in views
    ]
    return np.transpose(found)


def refitted(members: Sequence[Member], motion: Recording, asked: Asked) -> np.ndarray:
    """Return how far each pair of members is apart in a motion, (P,) noise floors.

    As `separation`, but every refit is simulated until it settles. NaN where a member cannot follow
    the motion.
    """
    return np.array(
        [
            np.minimum(_settled(one, other, motion, asked), _settled(other, one, motion, asked))
            for one, other in pairs(members)
        ]
    )


class _View(NamedTuple):
    """What a member says of motions and of the past, and how that changes with its values.

    Args:
        new: of each motion, K of (T M,) noises.
        past: (S,).
        new_slopes: K of (T M, P).
        past_slopes: (S, P).
    """

    new: list[np.ndarray]
    past: np.ndarray
    new_slopes: list[np.ndarray]
    past_slopes: np.ndarray

    @staticmethod
    def of(member: Member, motions: Sequence[Recording], asked: Asked) -> _View:
        values = _flat(member.fixed)
        steps = _within(values, _sizes(member.fixed, asked.spec), _ends(member.fixed, asked.spec))
        predicted = _predicted(member.fixed, values, motions, asked)
        slopes = [np.zeros((len(y), len(values))) for y in predicted]
        for place in np.flatnonzero(steps):
            changed = _predicted(
                member.fixed, values + steps * _unit(values, place), motions, asked
            )
            for slope, one, other in zip(slopes, changed, predicted, strict=True):
                slope[:, place] = (one - other) / steps[place]
        return _View(predicted[:-1], predicted[-1], slopes[:-1], slopes[-1])

    def left(self, other: _View, k: int, times: int) -> float:
        """Return what a linear refit of this leaves of another explanation's motion k."""
        off = np.concatenate([other.new[k] - self.new[k], other.past - self.past])
        slopes = np.concatenate([self.new_slopes[k], self.past_slopes])
        if not (np.isfinite(off).all() and np.isfinite(slopes).all()):
            return np.nan
        step = np.linalg.lstsq(slopes, off, rcond=None)[0]
        return _size((off - slopes @ step)[: len(self.new[k])], times)


def _settled(robot: Member, member: Member, motion: Recording, asked: Asked) -> float:
    """Return what is left of a robot's motion once a member has refitted, in noise floors."""
    wanted = _predicted(robot.fixed, _flat(robot.fixed), [motion], asked)
    sizes, ends = _sizes(member.fixed, asked.spec), _ends(member.fixed, asked.spec)

    def off(values: np.ndarray) -> np.ndarray:
        made = _predicted(member.fixed, values, [motion], asked)
        return np.concatenate(wanted) - np.concatenate(made)

    def slopes(values: np.ndarray) -> np.ndarray:
        error, steps = off(values), _within(values, sizes, ends)
        moved = [off(values + step * _unit(values, k)) - error for k, step in enumerate(steps)]
        return np.nan_to_num(np.stack(moved, axis=-1)) / np.where(steps, steps, 1.0)

    first = _flat(member.fixed)
    error = off(first)
    if np.isfinite(error).all():
        error = least_squares(
            off,
            first,
            jac=slopes,  # type: ignore[arg-type]
            bounds=ends,
            x_scale=sizes,
            max_nfev=TURNS,
        ).fun
    return _size(error[: len(wanted[0])], len(motion.time))


def _predicted(
    fixed: Sequence[Fixed], values: np.ndarray, motions: Sequence[Recording], asked: Asked
) -> list[np.ndarray]:
    """Return what encoders tell of each motion and, last, of the past, in noises."""
    columns, noise = list(asked.noise), np.array(list(asked.noise.values()))
    effects = merge_effects(asked.fixed, _at(fixed, values))
    if asked.changed is None:
        paths = trial(asked.spec, [*motions, *asked.past], fixed=effects)
    else:
        past = trial(asked.spec, asked.past, fixed=effects) if asked.past else []
        paths = [*trial(asked.changed, motions, fixed=effects), *past]
    predicted = [(path[:, columns] / noise).ravel() for path in paths]
    return [*predicted[: len(motions)], np.concatenate([np.zeros(0), *predicted[len(motions) :]])]


def _flat(fixed: Sequence[Fixed]) -> np.ndarray:
    """Return the effects' values in a row, (P,)."""
    return np.concatenate([np.zeros(0), *(np.asarray(values, float) for _, values in fixed)])


def _at(fixed: Sequence[Fixed], values: np.ndarray) -> list[Fixed]:
    """Return the effects with values (P,)."""
    parts = np.split(values, np.cumsum([len(own) for _, own in fixed])[:-1])
    return [
        (effect, tuple(map(float, part))) for (effect, _), part in zip(fixed, parts, strict=True)
    ]


def _ends(fixed: Sequence[Fixed], spec: mujoco.MjSpec) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the largest values, (P,) each."""
    model = spec.copy().compile()
    every = [parameter for effect, _ in fixed for parameter in effect.parameters(model)]
    return np.array([p.low for p in every]), np.array([p.high for p in every])


def _sizes(fixed: Sequence[Fixed], spec: mujoco.MjSpec) -> np.ndarray:
    """Return by how much each value is changed for its sensitivity, (P,)."""
    model, sizes = spec.copy().compile(), []
    for effect, values in fixed:
        parameters = effect.parameters(model)
        away = [abs(v - p.neutral) for v, p in zip(values, parameters, strict=True)]
        for own, parameter in zip(away, parameters, strict=True):
            alike = [a for a, p in zip(away, parameters, strict=True) if p.unit == parameter.unit]
            sizes.append(CHANGE * (own or max(alike)))
    return np.array(sizes)


def _within(
    values: np.ndarray, sizes: np.ndarray, ends: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Return the changes (P,) upwards, else downwards; 0 where both leave a value's range."""
    low, high = ends
    down = np.where(values - sizes >= low, -sizes, 0.0)
    return np.where(values + sizes <= high, sizes, down)


def _unit(values: np.ndarray, place: int | np.intp) -> np.ndarray:
    """Return 1 at a place, else 0, (P,)."""
    return (np.arange(len(values)) == place).astype(float)


def _size(noises: np.ndarray, times: int) -> float:
    """Return the distance, root mean square over time, summed over joints."""
    return float(np.sqrt((noises**2).sum() / times))
