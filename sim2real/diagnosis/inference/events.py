"""What happens once: a push on a joint, which no command tells, or readings that are off.

    for event in find_events(fitter, fit, left, before):
        event.effect, event.joint, event.seconds, event.size

An event is in one window alone, so that no other fold tells its size. It is a direction more of
that window's unknowns, with a prior width, and its evidence is the log ratio of the window's
densities with and without it: d' V^-1 e squared over 1 + d' V^-1 d, less log(1 + d' V^-1 d), by
halves (the matrix determinant lemma). From it goes what looking at so many joints and moments makes
by chance; and it has to take most of what is left there. A push moves a joint, and what it moved
comes back as the robot lets it; readings that are off jump, and jump back.
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
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.evidence import Pair
from sim2real.diagnosis.inference.candidates import Candidate
from sim2real.diagnosis.inference.fit import Fit, Fitter
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.probes import find_scalars
from sim2real.diagnosis.inference.products import HALF
from sim2real.diagnosis.inference.replayer import Job
from sim2real.diagnosis.schema import Kind
from sim2real.diagnosis.settings import TINY

PUSH, GLITCH = "push", "glitch"
EVENTS: dict[str, Kind] = {PUSH: "world", GLITCH: "log"}
LENGTHS = (0.1, 0.2, 0.4, 0.8)  # s: of an event
BEFORE = (0.0, 0.05, 0.1)  # s: by which a push begins before its effect is seen
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

    name = PUSH
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


class Event(NamedTuple):
    """An event that was found."""

    effect: str  # `PUSH` or `GLITCH`
    joint: str  # where it is
    window: int  # it is in
    log: int  # that window's, its number
    episode: int
    seconds: Pair  # from when to when, of the episode
    size: float  # a torque [N·m, or N of a slide], or by what readings are off [rad, m]
    evidence: float  # log ratio of the densities with and without it [nats]
    rival: str | None = None  # the other kind of event, if it is as probable


def find_events(
    fitter: Fitter, fit: Fit, left: np.ndarray, before: np.ndarray
) -> tuple[Event, ...]:
    """Return the events that most of what a fit leaves is of, the clearest first.

    None where they leave more: a law that is missing everywhere is no event. Nor where all of it is
    not worth a cause: of errors with one variance, the tolerance is a share of the squares. What
    the fit leaves of each reading is `left`, (W, N, M), and `before` what the model as given does.
    """
    found, held = [], 0.0
    of_window = left.sum(axis=(1, 2))
    least = 1 - math.exp(-fitter.settings.equivalence_tolerance / HALF)
    if left.sum() < least * before.sum():
        return ()
    for window in np.argsort(-of_window)[:MOST].tolist():
        event = _find_event(fitter, fit, left, window)
        if event is not None:
            found.append(event)
            held += of_window[window]
        if held >= PART * of_window.sum():
            return tuple(sorted(found, key=lambda one: -one.evidence))
    return ()


def _find_event(fitter: Fitter, fit: Fit, left: np.ndarray, window: int) -> Event | None:
    """Return the most probable event in a window; None where there is none."""
    rows = np.flatnonzero(left[window].sum(axis=1))
    if not len(rows):
        return None
    seen = float(fitter.replayer.times[window][rows[0]])
    tried = [*_try_pushes(fitter, fit, window, seen), *_try_glitches(fitter, fit, left, window)]
    if not tried:
        return None
    found = max(tried, key=lambda one: one.evidence)
    chance, level = math.log(len(tried) * len(left)), math.log(1 / fitter.settings.level)
    near = [one for one in tried if one.evidence > found.evidence - level]
    others = [one.effect for one in near if one.effect != found.effect]
    rival = others[0] if others else None
    return found._replace(rival=rival) if found.evidence > chance + level else None


def _try_pushes(fitter: Fitter, fit: Fit, window: int, seen: float) -> Iterator[Event]:
    """Yield every push that is looked at; what it does is seen from then on [s]."""
    replayer, values = fitter.replayer, fit.values[1 - int(fitter.fold[window])]
    some = np.array([window])
    spans = [(seen - b, seen - b + length) for b in BEFORE for length in LENGTHS]
    for joint in _list_joints(replayer.data):
        push = _candidate(replayer.data.joints[joint].name)
        jobs = [_job(fit.hypothesis, values, push, span, some) for span in spans]
        for span, replay in zip(spans, replayer.replay(jobs), strict=True):
            way = replay.error[0] - fit.held[window]
            yield _weigh(fitter, fit, Event(PUSH, *_place(replayer.data, joint, window, span)), way)


def _try_glitches(fitter: Fitter, fit: Fit, left: np.ndarray, window: int) -> Iterator[Event]:
    """Yield every moment for which a joint's readings may be off by a constant."""
    replayer, times = fitter.replayer, fitter.replayer.times[window]
    for joint in _list_joints(replayer.data):
        rows = left[window, :, joint] > 0
        if not rows.any():
            continue
        first = int(rows.argmax())
        run = first + int(np.append(~rows[first:], True).argmax()) - 1
        ends = [np.searchsorted(times, times[first] + length, "right") - 1 for length in LENGTHS]
        for last in sorted({run, *map(int, ends)}):
            way = np.zeros_like(fit.held[window])
            way[first : last + 1, joint] = 1.0
            span = float(times[first]), float(times[last])
            event = Event(GLITCH, *_place(replayer.data, joint, window, span))
            yield _weigh(fitter, fit, event, way)


def _list_joints(data: Data) -> list[int]:
    """Return the numbers of hinges and slides: a base's turn is compared, and no joint."""
    known = find_scalars(data)
    return [number for number, joint in enumerate(data.joints) if joint.name in known]


def _place(
    data: Data, joint: int, window: int, span: Pair
) -> tuple[str, int, int, int, Pair, float, float]:
    """Return where an event is, from and to when, and no size nor evidence."""
    own = data.windows[window]
    origin = float(data.logs[own.log].time[own.start])
    seconds = (origin + span[0], origin + span[1])
    return data.joints[joint].name, window, own.log, own.episode, seconds, 0.0, -math.inf


def _weigh(fitter: Fitter, fit: Fit, event: Event, way: np.ndarray) -> Event:
    """Return an event of unit size, which changes a window's errors by (N, M), with both."""
    data, window = fitter.replayer.data, event.window
    joint = next(one for one in data.joints if one.name == event.joint)
    size = joint.spread / joint.scale / max(float(np.abs(way).max()), TINY)
    vectors = np.zeros((*fit.held.shape, 2))
    vectors[window] = np.stack([fit.held[window], way * size], axis=-1)
    trained = fit.trained[1 - int(fitter.fold[window])]
    gram = fitter.likelihood.curvature(trained, vectors, np.array([window]))
    square, across = 1 + gram[1, 1], gram[0, 1]
    taken = across**2 / square  # of the window's whitened square
    if taken <= PART * gram[0, 0]:
        return event
    found, scale = -across / square * size, 1.0 if event.effect == PUSH else joint.scale
    evidence = (taken - math.log(square)) * HALF
    return event._replace(size=float(found * scale), evidence=float(evidence))


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
