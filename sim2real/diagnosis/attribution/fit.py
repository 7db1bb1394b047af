"""Values of effects: found on one fold of the windows, judged on the other.

    fit = refine(problem, (candidate,), starts)            # values (2, P), one row for each fold

Both folds are fitted side by side in the same batches.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from sim2real.diagnosis.attribution.bounds import Bounds
from sim2real.diagnosis.attribution.candidates import FREE, Candidate
from sim2real.diagnosis.attribution.problem import FOLDS, Ask, Problem
from sim2real.diagnosis.settings import DEFAULT, TINY_SQUARE, Fitting

NAMED = 3  # fits of several that are told by name
T = TypeVar("T")


@dataclass(frozen=True)
class Fit:
    """Members with their values, one row for each fold, and the mean square errors there."""

    members: tuple[Candidate, ...]
    values: np.ndarray  # (2, P)
    cost: np.ndarray  # (2,)

    @property
    def mean(self) -> np.ndarray:
        """The values over both folds, (P,)."""
        return self.values.mean(axis=0)


def columns(members: Sequence[Candidate]) -> list[slice]:
    """Return where each member's parameters are in a row of values."""
    ends = np.cumsum([len(m.neutral) for m in members], dtype=int)
    return [slice(end - len(m.neutral), end) for m, end in zip(members, ends, strict=True)]


def refine(
    problem: Problem,
    members: Sequence[Candidate],
    starts: np.ndarray,
    rounds: int = DEFAULT.fitting.rounds,
) -> Fit:
    """Fit the members' values by damped Gauss-Newton steps from the best of several starts.

    Args:
        problem: on the windows to look at.
        members: the effects.
        starts: (K, P), or (K, 2, P) where the folds start from values of their own.
        rounds: steps at most.
    """
    return refine_each(problem, [Job(tuple(members), starts, rounds)])[0]


class Job(NamedTuple):
    """A fit to be made; see `refine`."""

    members: tuple[Candidate, ...]
    starts: np.ndarray
    rounds: int = DEFAULT.fitting.rounds


def in_words(jobs: Sequence[Job]) -> str:
    """Return what is tried: the newest member of each fit, the first few by name."""
    if not jobs:
        return "nothing"
    newest = [job.members[-1].label for job in jobs]
    more = f" and {len(newest) - NAMED} more" if len(newest) > NAMED else ""
    return ", ".join(newest[:NAMED]) + more


def refine_each(problem: Problem, jobs: Sequence[Job]) -> list[Fit]:
    """Make several fits on the same windows, side by side: each of their steps is one simulation.

    Args:
        problem: on the windows to look at.
        jobs: the fits.
    """
    fits: dict[int, Fit] = {}
    steps = {number: _steps(problem, job) for number, job in enumerate(jobs)}
    asks = {number: next(step) for number, step in steps.items()}
    while asks:
        seen = dict(zip(asks, problem.errors_each(list(asks.values())), strict=True))
        asks = {}
        for number, errors in seen.items():
            try:
                asks[number] = steps[number].send(errors)
            except StopIteration as end:
                fits[number] = end.value
    return [fits[number] for number in range(len(jobs))]


Steps = Generator[Ask, tuple[np.ndarray, np.ndarray], T]  # asks for simulations, is sent errors


def _steps(problem: Problem, job: Job) -> Steps[Fit]:
    """Make a fit whose simulations another one makes."""
    members, starts = tuple(job.members), job.starts
    starts = np.repeat(starts[:, None], FOLDS, axis=1) if starts.ndim == 2 else starts
    bounds = Bounds(members)
    points = bounds.clip(starts)
    error, slope = yield Ask(members, points)
    costs = problem.cost(error, slope)  # (K, 2)
    state = _Pick(problem, points, error, slope, costs)
    for _ in range(job.rounds):
        before = state.cost.copy()
        yield from _round(problem, members, bounds, state)
        if (state.cost > (1 - problem.settings.settled) * before).all():
            break
    return Fit(members, state.values, state.cost)


class _Pick:
    """The best point of each fold so far, and the errors there."""

    def __init__(
        self,
        problem: Problem,
        points: np.ndarray,
        error: np.ndarray,
        slope: np.ndarray,
        costs: np.ndarray,
    ) -> None:
        self._fold = problem.fold
        best = costs.argmin(axis=0)
        self.values = np.stack([points[best[f], f] for f in range(FOLDS)])
        self.cost = costs.min(axis=0)
        self.error, self.slope = error[0].copy(), slope[0].copy()
        for f in range(FOLDS):
            own = self._fold == f
            self.error[own], self.slope[own] = error[best[f]][own], slope[best[f]][own]

    def improve(
        self, points: np.ndarray, error: np.ndarray, slope: np.ndarray, costs: np.ndarray
    ) -> None:
        for f in range(FOLDS):
            best = int(costs[:, f].argmin())
            if costs[best, f] < self.cost[f]:
                own = self._fold == f
                self.values[f], self.cost[f] = points[best, f], costs[best, f]
                self.error[own], self.slope[own] = error[best][own], slope[best][own]


def nudges(
    members: Sequence[Candidate], values: np.ndarray, settings: Fitting = DEFAULT.fitting
) -> np.ndarray:
    """Return a step of each parameter for finite differences, (2, P), towards where it may go."""
    bounds = Bounds(members)
    size = np.abs(np.where(bounds.neutral >= FREE, values, values - bounds.neutral))
    step = settings.difference * np.maximum(size, settings.difference_min * bounds.step)
    return np.where(values + step > bounds.high, -step, step)


def sensitivities(
    problem: Problem, members: Sequence[Candidate], values: np.ndarray, error: np.ndarray
) -> np.ndarray:
    """Return how the errors change with each parameter at values (2, P), (P, W, T, M)."""
    step = nudges(members, values, problem.settings)
    moved, _ = problem.errors(members, _nudged(values, step))
    return _slopes(problem, moved - error, step)


def _nudged(values: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return values (2, P) with one parameter moved in each, (P, 2, P)."""
    size = values.shape[1]
    points = np.repeat(values[None], size, axis=0)
    points[np.arange(size), :, np.arange(size)] += step.T
    return points


def _slopes(problem: Problem, change: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return changes (P, W, T, M) over the steps (2, P) that made them."""
    return change / step.T[:, problem.fold][:, :, None, None]


def _round(
    problem: Problem, members: tuple[Candidate, ...], bounds: Bounds, state: _Pick
) -> Steps[None]:
    """Take one step in each fold: the whole one, or the best of several dampings if that fails."""
    step = nudges(members, state.values, problem.settings)
    moved, _ = yield Ask(members, _nudged(state.values, step))
    change = _slopes(problem, moved - state.error, step)  # (P, W, T, M)
    whole, *damped = problem.settings.dampings
    before, lines = state.cost.copy(), [_Line.of(problem, state, change, f) for f in range(FOLDS)]

    def trials(dampings: Sequence[float]) -> np.ndarray:
        moves = [[line.step(d, problem.settings) for line in lines] for d in dampings]
        return bounds.clip(state.values - np.array(moves))  # (K, 2, P)

    first, further = trials([whole]), trials(damped)
    told = [line.fall(first[0, f] - state.values[f]) for f, line in enumerate(lines)]
    error, slope = yield Ask(members, first)
    state.improve(first, error, slope, problem.cost(error, slope))
    if damped and not _as_told(before, before - state.cost, np.array(told), problem.settings):
        error, slope = yield Ask(members, further)
        state.improve(further, error, slope, problem.cost(error, slope))


def _as_told(before: np.ndarray, fell: np.ndarray, told: np.ndarray, settings: Fitting) -> bool:
    """Return whether the costs of both folds fell about as a step's linear model told, (2,) each.

    Where it promises next to nothing, nothing shorter would do better.
    """
    told = told * before
    return bool(((fell >= settings.trusted * told) | (told <= settings.still * before)).all())


class _Line(NamedTuple):
    """The straight line that errors of a fold are taken for, with the clock set."""

    error: np.ndarray  # (n,)
    flat: np.ndarray  # (P, n) their change with each parameter

    @staticmethod
    def of(problem: Problem, state: _Pick, change: np.ndarray, fold: int) -> _Line:
        own = problem.fold == fold
        drift = state.slope[own].ravel()
        flat = change[:, own].reshape(len(change), -1)
        error = state.error[own].ravel()
        along = max(float(drift @ drift), TINY_SQUARE)
        shift = -(error @ drift) / along
        if abs(shift) < problem.clock:  # the clock is free to follow
            return _Line(error + shift * drift, flat - (flat @ drift / along)[:, None] * drift)
        return _Line(error + np.sign(shift) * problem.clock * drift, flat)

    def step(self, damping: float, settings: Fitting) -> np.ndarray:
        """Return what a damped step takes off the values, (P,)."""
        curve, down = self.flat @ self.flat.T, self.flat @ self.error
        size = np.diag(curve) + settings.ridge * max(np.trace(curve), TINY_SQUARE)
        matrix = curve + np.diag((damping + settings.damping_min) * size)
        return np.linalg.solve(matrix, down)

    def fall(self, move: np.ndarray) -> float:
        """Return the share of the squared error that values moved by (P,) would take away."""
        before = max(float(self.error @ self.error), TINY_SQUARE)
        left = self.error + move @ self.flat
        return 1.0 - float(left @ left) / before
