"""Values of effects: found on one fold of the windows, judged on the other.

    problem = Problem(data, simulator)
    base = problem.held_out((), np.zeros((2, 0)))          # errors with the model as given
    fit = refine(problem, (candidate,), starts)            # values (2, P), one row for each fold

Both folds are fitted side by side in the same batches: windows of fold f are simulated under the
values of fold f, and to be judged under those of the other one. A shift of the clock by less than a
simulation step, or half of one, is fitted along, since no log knows its stamps better.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from sim2real.diagnosis.attribution.batches import Rows, simulate_each
from sim2real.diagnosis.attribution.bounds import Bounds
from sim2real.diagnosis.attribution.candidates import FREE, Candidate
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.settings import DEFAULT, TINY_SQUARE, Fitting

FOLDS = 2
NAMED = 3  # fits of several that are told by name
T = TypeVar("T")


class Ask(NamedTuple):
    """What a fit wants to see simulated."""

    members: tuple[Candidate, ...]
    points: np.ndarray  # (K, 2, P) values of their parameters, one row for each fold


class Problem:
    """Data, its simulator and the windows that a fit looks at.

    Args:
        data: the windows.
        simulator: of these windows.
        chosen: indices of the windows to look at, (n,); None for all.
        weight: what the errors of each window of the data count, (W,); None: all are 1.
    """

    def __init__(
        self,
        data: Data,
        simulator: Simulator,
        chosen: np.ndarray | None = None,
        weight: np.ndarray | None = None,
    ) -> None:
        self.data, self.simulator = data, simulator
        self.settings = data.settings.fitting
        self.windows = np.arange(len(data.windows)) if chosen is None else np.sort(chosen)
        self.fold = data.fold[self.windows]
        self.weight = None if weight is None else weight[self.windows]
        self.clock = _clock(data)
        self.rows = data.mask[self.windows].sum() * len(data.joints)

    def subset(self, chosen: np.ndarray, weight: np.ndarray | None = None) -> Problem:
        """Return the same problem on fewer windows, (n,) indices, that count so much, (W,)."""
        return Problem(self.data, self.simulator, chosen, weight)

    def by(self, simulator: Simulator) -> Problem:
        """Return the same problem, simulated by another simulator of the same windows."""
        other = copy(self)
        other.simulator = simulator
        return other

    def errors(
        self, members: Sequence[Candidate], points: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return errors and clock slopes, (K, W, T, M), under points (K, 2, P), one a fold."""
        return self.errors_each([Ask(tuple(members), points)])[0]

    def errors_each(
        self, asks: Sequence[Ask], remember: bool = True
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return what `errors` does of several asks, simulated side by side.

        `remember` takes what was simulated before from memory; see `simulate_each`.
        """
        sets = []
        for members, points in asks:
            values = points[:, self.fold].reshape(len(points) * len(self.windows), -1)  # (K W, P)
            sets.append(Rows(members, np.tile(self.windows, len(points)), values))
        found = []
        for result in simulate_each(self.simulator, sets, remember):
            shape = (-1, len(self.windows), *result.error.shape[1:])
            error, slope = result.error.reshape(shape), result.slope.reshape(shape)
            weight = 1.0 if self.weight is None else self.weight[:, None, None]
            found.append((weight * error, weight * slope))
        return found

    def shift(self, error: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Return the clock's shift [s] that fits best in each fold, (..., 2), of (..., W, T, M)."""
        across = (error * slope).sum(axis=(-2, -1))  # (..., W)
        along = (slope * slope).sum(axis=(-2, -1))
        found = [
            -across[..., self.fold == f].sum(-1)
            / np.maximum(along[..., self.fold == f].sum(-1), TINY_SQUARE)
            for f in range(FOLDS)
        ]
        return np.clip(np.stack(found, axis=-1), -self.clock, self.clock)

    def cost(self, error: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Return the mean square error of each fold, its clock set, (..., 2)."""
        shift = self.shift(error, slope)[..., self.fold]  # (..., W)
        square = ((error + shift[..., None, None] * slope) ** 2).sum(axis=(-2, -1))
        counts = self.data.mask[self.windows].sum(axis=1) * error.shape[-1]
        found = [
            square[..., self.fold == f].sum(-1) / max(counts[self.fold == f].sum(), 1)
            for f in range(FOLDS)
        ]
        return np.stack(found, axis=-1)

    def held_out(self, members: Sequence[Candidate], values: np.ndarray) -> np.ndarray:
        """Return the errors (W, T, M) of each window under the values (2, P) of the other fold.

        The clock is the other fold's as well.
        """
        return self._held_out([Ask(tuple(members), values)])[0]

    def held_out_each(self, fits: Sequence[Fit]) -> list[np.ndarray]:
        """Return the held-out errors of several fits, (W, T, M) each, simulated side by side."""
        return self._held_out([Ask(fit.members, fit.values) for fit in fits])

    def _held_out(self, asks: Sequence[Ask]) -> list[np.ndarray]:
        """Return the held-out errors under values (2, P) of each fold."""
        both = [Ask(m, np.stack([v, v[::-1]] if m else [v])) for m, v in asks]
        found = []
        for error, slope in self.errors_each(both):
            shift = self.shift(error[0], slope[0])[::-1]
            found.append(error[-1] + shift[self.fold][:, None, None] * slope[-1])
        return found


def _clock(data: Data) -> float:
    """Return by how much the log's clock may be off [s].

    A command acts from the next step of the simulation on: half a step late in the mean. Beyond
    that, a clock that is free to follow takes lags for its own that are the robot's.
    """
    step = max(model.opt.timestep for model in data.models)
    stamps = [f"stamp.{joint.name}" for joint in data.joints]
    known = all(stamp in log.columns for log in data.logs for stamp in stamps)
    limits = data.settings.fitting
    return limits.stamped_steps * step if known else max(limits.clock_s, step)


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
    """Take one step in each fold, the best of several dampings."""
    step = nudges(members, state.values, problem.settings)
    moved, _ = yield Ask(members, _nudged(state.values, step))
    change = _slopes(problem, moved - state.error, step)  # (P, W, T, M)
    settings = problem.settings
    trials = np.repeat(state.values[None], len(settings.dampings), axis=0)
    for f in range(FOLDS):
        own = problem.fold == f
        drift = state.slope[own].ravel()
        flat = change[:, own].reshape(len(change), -1)
        error = state.error[own].ravel()
        along = max(float(drift @ drift), TINY_SQUARE)
        shift = -(error @ drift) / along
        if abs(shift) < problem.clock:  # the clock is free to follow
            flat = flat - (flat @ drift / along)[:, None] * drift
            error = error + shift * drift
        else:
            error = error + np.sign(shift) * problem.clock * drift
        curve, down = flat @ flat.T, flat @ error
        size = np.diag(curve) + settings.ridge * max(np.trace(curve), TINY_SQUARE)
        for k, damping in enumerate(settings.dampings):
            matrix = curve + np.diag((damping + settings.damping_min) * size)
            trials[k, f] -= np.linalg.solve(matrix, down)
    trials = bounds.clip(trials)
    error, slope = yield Ask(members, trials)
    state.improve(trials, error, slope, problem.cost(error, slope))
