"""A push: a torque on one joint during some moments of one episode, which no command tells.

    for push in find_pushes(fitter, fit, left, before):
        push.joint, push.seconds, push.torque

A push is in one window alone, so that no other fold tells its size. It is a direction more of that
window's unknowns, with a prior width, and its evidence is the log ratio of the window's densities
with and without it: d' V^-1 e squared over 1 + d' V^-1 d, less log(1 + d' V^-1 d), by halves (the
matrix determinant lemma). From it goes what looking at so many joints and moments makes by chance;
and it has to take most of what is left there.
"""

import math
from collections.abc import Iterator
from typing import ClassVar, NamedTuple

import mujoco
import numpy as np

from envs.effects import BoundEffect, Effect
from envs.effects.base import RULES
from envs.effects.bound import SubstepRule
from envs.effects.extras import Extra
from envs.effects.places import joints
from envs.effects.plant_view import PlantView
from envs.params import Parameter
from sim2real.diagnosis.evidence import Pair
from sim2real.diagnosis.inference.candidates import Candidate
from sim2real.diagnosis.inference.fit import Fit, Fitter
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.probes import find_scalars
from sim2real.diagnosis.inference.products import HALF
from sim2real.diagnosis.inference.replayer import Job
from sim2real.diagnosis.settings import TINY

LENGTHS = (0.1, 0.2, 0.4, 0.8)  # s: of a push
BEFORE = (0.0, 0.05, 0.1)  # s: by which it begins before its effect is seen
PART = 0.7  # of what is left, that has to lie where it is said to lie
MOST = 8  # windows that are looked at, those with most left
LONGEST = 1e6  # s


class _Torque(SubstepRule):
    """See `Push`."""

    order = 60

    def __init__(self, plant: PlantView, effect: Effect) -> None:
        self._effect, self._applied, self._time = effect, plant.applied, plant.time
        self._dofs = plant.model.jnt_dofadr[joints(plant.model, effect.where)]
        self._value, self._start, self._end = np.zeros((3, plant.num_rows))

    def write(self, ids: np.ndarray, values: np.ndarray) -> None:
        self._value[ids] = values[:, 0]
        self._start[ids] = self._effect.scalar("start", values)
        self._end[ids] = self._effect.scalar("end", values)

    def before_substep(self, ids: np.ndarray | slice) -> None:
        acts = (self._time[ids] >= self._start[ids]) & (self._time[ids] < self._end[ids])
        rows = np.arange(len(self._value))[ids]
        self._applied[rows[:, None], self._dofs] += (acts * self._value[ids])[:, None]


class Push(Effect):
    """A constant torque on a joint from one moment of a window to another."""

    name = "push"
    place = "joint"
    unit = "N·m"
    extras: ClassVar[tuple[Extra, ...]] = (
        Extra("start", "s", 0.0, -LONGEST, LONGEST, "when it begins, from the window's start"),
        Extra("end", "s", 0.0, -LONGEST, LONGEST, "when it ends"),
    )
    symptom = "one joint moves off at one moment, and nowhere else"
    source = "a hand, an obstacle, a cable"
    experiment = "the same recording with nobody near the robot"

    def parameters(self, model: mujoco.MjModel) -> tuple[Parameter, ...]:
        """Return the torque, and the moments where these are free."""
        return (self.parameter(), *self.free_parameters())

    def bind(self, plant: PlantView) -> BoundEffect:
        """Apply each row's torque."""
        return _Torque(plant, self)

    def batch(self) -> str:
        """Return the group of effects that act between physics steps."""
        return RULES


class Pushed(NamedTuple):
    """A push that was found."""

    joint: str  # it acts on
    window: int  # it is in
    log: int  # that window's, its number
    episode: int
    seconds: Pair  # from when to when it acts, of the episode
    torque: float  # of the joint [N·m, or N of a slide]
    evidence: float  # log ratio of the densities with and without it [nats]


def find_pushes(
    fitter: Fitter, fit: Fit, left: np.ndarray, before: np.ndarray
) -> tuple[Pushed, ...]:
    """Return the pushes that most of what a fit leaves is of, the clearest first.

    None where they leave more: a law that is missing everywhere is no push. Nor where all of it is
    not worth a cause: of errors with one variance, the tolerance is a share of the squares. What
    the fit leaves of each reading is `left`, (W, N, M), and `before` what the model as given does.
    """
    found, held = [], 0.0
    of_window = left.sum(axis=(1, 2))
    least = 1 - math.exp(-fitter.settings.equivalence_tolerance / HALF)
    if left.sum() < least * before.sum():
        return ()
    for window in np.argsort(-of_window)[:MOST].tolist():
        push = _find_push(fitter, fit, left, window)
        if push is not None:
            found.append(push)
            held += of_window[window]
        if held >= PART * of_window.sum():
            return tuple(sorted(found, key=lambda one: -one.evidence))
    return ()


def _find_push(fitter: Fitter, fit: Fit, left: np.ndarray, window: int) -> Pushed | None:
    """Return the most probable push in a window; None where there is none."""
    rows = left[window].sum(axis=1)
    if not rows.any():
        return None
    seen = float(fitter.replayer.times[window][np.flatnonzero(rows)[0]])
    tried = list(_tried(fitter, fit, window, seen))
    if not tried:
        return None
    found = max(tried, key=lambda one: one.evidence)
    chance = math.log(len(tried) * len(left) / fitter.settings.level)
    return found if found.evidence > chance else None


def _tried(fitter: Fitter, fit: Fit, window: int, seen: float) -> Iterator[Pushed]:
    """Yield every push that is looked at, with its evidence."""
    replayer, data = fitter.replayer, fitter.replayer.data
    side = 1 - int(fitter.fold[window])
    own = data.windows[window]
    origin = float(data.logs[own.log].time[own.start])
    values, some = fit.values[side], np.array([window])
    spans = [(seen - b, seen - b + length) for b in BEFORE for length in LENGTHS]
    hinges = find_scalars(data)  # and slides: a base's turn is compared, and no joint
    for joint in (joint for joint in data.joints if joint.name in hinges):
        push = _candidate(joint.name)
        jobs = [_job(fit.hypothesis, values, push, span, some) for span in spans]
        directions = np.stack([one.error[0] for one in replayer.replay(jobs)]) - fit.held[window]
        size = joint.spread / joint.scale
        for (a, b), way in zip(spans, directions, strict=True):
            most = max(float(np.abs(way).max()), TINY)
            vectors = np.zeros((*fit.held.shape, 2))
            vectors[window] = np.stack([fit.held[window], way * size / most], axis=-1)
            gram = fitter.likelihood.curvature(fit.trained[side], vectors, some)
            square, across = 1 + gram[1, 1], gram[0, 1]
            taken = across**2 / square  # of the window's whitened square
            evidence = (taken - math.log(square)) * HALF if taken > PART * gram[0, 0] else -math.inf
            seconds = (origin + a, origin + b)
            torque = -across / square * size / most
            moment = own.log, own.episode, seconds
            yield Pushed(joint.name, window, *moment, torque, float(evidence))


def _candidate(joint: str) -> Candidate:
    """Return a push of a joint as a member, its torque and its moments free."""
    every = np.array([1.0, 0.0, 1.0])
    effect = Push(joint, free=("start", "end"))
    none, far = np.zeros_like(every), np.full_like(every, LONGEST)
    return Candidate(effect, joint, every[None], none, -far, far, RULES)


def _job(
    hypothesis: Hypothesis, values: np.ndarray, push: Candidate, span: Pair, some: np.ndarray
) -> Job:
    """Return a window with a push of one newton metre added to a hypothesis."""
    count = sum(len(member.neutral) for member in hypothesis.effects)
    pushed = Hypothesis((*hypothesis.effects, push, *hypothesis.changes))
    return Job(pushed, np.insert(values, count, [1.0, *span])[None], some)
