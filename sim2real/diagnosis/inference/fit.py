"""Values of hypotheses, found on one fold and judged on the other, many side by side.

    fits = Fitter(replayer, likelihood, fold).fit([Start(hypothesis, points)])
    fits[0].score, fits[0].values               # (W,) nats held out, (2, P)

Damped Gauss-Newton steps (Levenberg and Marquardt) in the metric of the likelihood: where starts
or usual errors explain a change as well, it moves nothing. Of several points each fold keeps the
best before it refines. Waves are fitted by their cosine and sine parts. Slopes are finite
differences at first, of replays in longer time steps; each step corrects them by what it changed
(Broyden 1965, doi:10.1090/S0025-5718-1965-0198670-6), and where they lead no further they are taken
anew. A step that then promises no more than rounding ends the fit. What no slope leads to, whole
numbers and edges at which a force jumps, is tried nearby first, step by step. The
discrepancy's size is estimated anew at each trial, so that a step is judged by the density that
decides.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from sim2real.diagnosis.data.together import together
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.likelihood import Likelihood, Trained
from sim2real.diagnosis.inference.products import HALF
from sim2real.diagnosis.inference.replayer import Job, Replay, Replayer
from sim2real.diagnosis.inference.score import FOLDS
from sim2real.diagnosis.inference.state import BETTER, State, widen


class Start(NamedTuple):
    """Where a fit begins."""

    hypothesis: Hypothesis
    points: np.ndarray  # (K, P), or (K, 2, P) where the folds start from values of their own


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis with its values, and how well they predict."""

    hypothesis: Hypothesis  # what was fitted
    values: np.ndarray  # (2, P) fitted to each fold
    own: np.ndarray  # (W, N, M) errors under the values fitted to the window's own fold
    held: np.ndarray  # (W, N, M) errors under the values fitted to the other fold
    trained: tuple[Trained, ...]  # the discrepancy of each fold under its own values
    density: np.ndarray  # (2,) log density of each fold under its own values [nats]
    # (W,) log predictive density of each window, given the other fold, less what the usual errors
    # of the model cost [nats]
    score: np.ndarray

    @property
    def total(self) -> float:
        """Log predictive density of all windows [nats]."""
        return float(self.score.sum())

    @property
    def mean(self) -> np.ndarray:
        """The values over both folds, (P,)."""
        linear = self.hypothesis.to_linear(self.values)
        return self.hypothesis.from_linear(linear.mean(axis=0))

    @property
    def label(self) -> str:
        """The hypothesis's."""
        return self.hypothesis.label


class Fitter:
    """Fits hypotheses to windows, each of a fold, (W,), by the likelihood of their errors.

    `quick` replays them in longer time steps, for slopes; None: as they are judged.
    """

    def __init__(
        self,
        replayer: Replayer,
        likelihood: Likelihood,
        fold: np.ndarray,
        quick: Replayer | None = None,
    ) -> None:
        self.replayer, self.likelihood, self.fold = replayer, likelihood, fold
        self._quick = quick
        self.settings = replayer.settings
        self.sides = [np.flatnonzero(fold == side) for side in range(FOLDS)]

    def fit(self, starts: Iterable[Start], rounds: int | None = None) -> list[Fit]:
        """Return the fits of hypotheses, each from the best of its points.

        They race: one that would not reach the best at the pace of its last step goes no further.
        A step that failed says nothing of the pace of the next, which is damped more. They take so
        many rounds at most; None: those of the settings.
        """
        states = self._begin(starts)
        rounds = self.settings.rounds if rounds is None else rounds
        self._walk(states, rounds)
        live = [state for state in states if state.hypothesis.smooth.any()]
        for left in reversed(range(rounds)):
            live = self._step(live) if live else []
            best = max((state.density.sum() for state in states), default=0.0)
            live = [one for one in live if one.within_reach(best, left)]
        return self._finish(states)

    def replay_points(self, starts: Sequence[Start]) -> list[np.ndarray]:
        """Return the errors, (W, N, M), of the first point of each start."""
        jobs = [(s.hypothesis, s.hypothesis.clip(s.points[0])) for s in starts]
        return [replay.error for replay in self._replay(jobs)]

    def judge(self, hypothesis: Hypothesis, values: np.ndarray, paths: Sequence[np.ndarray]) -> Fit:
        """Return values (2, P) of a hypothesis as a fit by this likelihood, without a replay.

        Their errors `Fit.own` and `Fit.held`, (W, N, M) each, are known: `paths`.
        """
        own, held = (Replay(errors, np.zeros_like(errors)) for errors in paths)
        state = State(hypothesis, values, own, self._train(own))
        return _as_fit(state, held, self._score(state, held))

    def imitating(self, fit: Fit) -> Fitter:
        """Return what fits hypotheses to the motions that a fit predicts, in place of the log's."""
        other, replayer = copy(self), copy(self.replayer)
        replayer.offset = replayer.offset - fit.own
        other.replayer = replayer
        return other

    def curvature(self, fit: Fit, vectors: np.ndarray, tempered: bool = True) -> np.ndarray:
        """Return `Likelihood.curvature`, (P, P), each fold's windows under its own discrepancy."""
        pairs = zip(fit.trained, self.sides, strict=True)
        each = [self.likelihood.curvature(one, vectors, own, tempered) for one, own in pairs]
        return np.sum(each, axis=0)

    def score_within(
        self, fit: Fit, ranges: Sequence[Sequence[Any]], near: bool = False
    ) -> np.ndarray:
        """Return the scores of a fit, (K, W) nats, whose discrepancy has a size within a range.

        Ranges are smallest and largest sizes in noises, numbers or (M,) each; `near` begins with
        the discrepancy as large as it is where it is free.
        """
        scores = np.zeros((len(ranges), len(self.fold)))
        for side, own in enumerate(self.sides):
            projection = self.likelihood.project(self._seen_from(side, fit.own, fit.held))
            begin, other = fit.trained[side] if near else None, self.sides[1 - side]
            for score, sizes in zip(scores, ranges, strict=True):
                trained = self.likelihood.train(projection, own, sizes, begin)
                predicted = self.likelihood.predict(projection, trained, sizes)
                score[other] = (predicted - self.likelihood.charge(trained))[other]
        return scores

    def _begin(self, starts: Iterable[Start]) -> list[State]:
        """Return each start at the best of its points."""
        jobs: list[tuple[Hypothesis, np.ndarray]] = []
        owners: list[int] = []
        for number, (hypothesis, points) in enumerate(starts):
            spread = np.repeat(points[:, None], FOLDS, axis=1) if points.ndim == 2 else points
            for values in hypothesis.clip(spread):
                jobs.append((hypothesis, values))
                owners.append(number)
        states: dict[int, State] = {}
        for owner, state in zip(owners, self._make(jobs, self._replay(jobs)), strict=True):
            state.damping[:] = self.settings.damping
            if owner in states:
                states[owner].take(state, self.fold)
            else:
                states[owner] = state
        return [states[number] for number in sorted(states)]

    def _replay(
        self, jobs: Sequence[tuple[Hypothesis, np.ndarray]], quick: Replayer | None = None
    ) -> list[Replay]:
        """Return what each hypothesis makes of all windows under values (2, P) of their folds."""
        every, replayer = self.replayer.every, self.replayer if quick is None else quick
        return replayer.replay([Job(h, values[self.fold], every) for h, values in jobs])

    def _make(
        self,
        jobs: Sequence[tuple[Hypothesis, np.ndarray]],
        replays: Sequence[Replay],
        near: Sequence[Sequence[Trained]] | None = None,
    ) -> list[State]:
        """Return each hypothesis under values (2, P), its discrepancy trained, on several cores."""
        pairs = zip(replays, [None] * len(jobs) if near is None else near, strict=True)
        every = together([partial(self._train, *pair) for pair in pairs])
        made = zip(jobs, replays, every, strict=True)
        return [State(*job, replay, trained) for job, replay, trained in made]

    def _train(self, replay: Replay, near: Sequence[Trained] | None = None) -> list[Trained]:
        """Return the discrepancy of each fold."""
        projection = self.likelihood.project(replay.error)
        return [
            self.likelihood.train(projection, own, near=None if near is None else near[side])
            for side, own in enumerate(self.sides)
        ]

    def _walk(self, states: Sequence[State], rounds: int) -> None:
        """Move to values that no slope leads to as long as that gains what a step has to, in place.

        What gains by itself, such as at one joint of several, is tried together, too.
        """
        live = list(states)
        for _ in range(rounds):
            near = [(s, values) for s in live for values in s.hypothesis.list_near(s.values)]
            trials = self._try(near)
            joined = [(s, s.join([other for one, other in trials if one is s])) for s in live]
            trials += self._try([(s, values) for s, values in joined if values is not None])
            gains = [(s, s.take(other, self.fold)) for s, other in trials]
            live = list(dict.fromkeys(s for s, gain in gains if gain.max() > self.settings.settled))

    def _try(self, trials: Sequence[tuple[State, np.ndarray]]) -> list[tuple[State, State]]:
        """Return each state with what it would be at other values (2, P)."""
        jobs = [(state.hypothesis, values) for state, values in trials]
        made = self._make(jobs, self._replay(jobs))
        return [(state, other) for (state, _), other in zip(trials, made, strict=True)]

    def _step(self, states: Sequence[State]) -> list[State]:
        """Take one step with each that promises a gain, and return those that may gain more."""
        self._differentiate([state for state in states if state.slopes is None])
        trials = {id(state): self._trial(state) for state in states}
        stale = [state for state in states if not (state.fresh or trials[id(state)].promises)]
        self._differentiate(stale)
        trials |= {id(state): self._trial(state) for state in stale}
        states = [state for state in states if trials[id(state)].promises]
        pairs = [(state.hypothesis, trials[id(state)].values) for state in states]
        made = self._make(pairs, self._replay(pairs), [state.trained for state in states])
        return [one for one, other in zip(states, made, strict=True) if self._improve(one, other)]

    def _differentiate(self, states: Sequence[State]) -> None:
        """Give each the slopes of its errors with its values, by finite differences."""
        nudges = [
            state.nudges(self.settings.difference, self.settings.difference_min) for state in states
        ]
        jobs = [
            (state.hypothesis, state.moved(nudge * (np.arange(nudge.shape[1]) == place)))
            for state, nudge in zip(states, nudges, strict=True)
            for place in state.places
        ]
        moved = iter(self._replay(jobs, self._quick))
        bases = [state.replay for state in states]
        if self._quick is not None:
            bases = self._replay([(one.hypothesis, one.values) for one in states], self._quick)
        for state, base, nudge in zip(states, bases, nudges, strict=True):
            slopes = [
                (next(moved).error - base.error) / widen(nudge[self.fold, place], base.error)
                for place in state.places
            ]
            state.slopes, state.fresh = np.stack(slopes, axis=-1), True

    def _trial(self, state: State) -> _Trial:
        """Return a damped step, and whether it promises a gain: g's - s'H s / 2 nats of step s."""
        vectors = np.concatenate([state.replay.error[..., None], state.slopes], axis=-1)
        size = self.settings.reach * state.hypothesis.linear_size[state.places]
        change, gains = np.zeros_like(state.values), []
        for side, own in enumerate(self.sides):
            products = self.likelihood.curvature(state.trained[side], vectors, own)
            curve, down = products[1:, 1:], products[1:, 0]
            damping = state.damping[side] + self.settings.ridge
            diagonal = np.diag(curve) + 1 / size**2
            step = np.linalg.solve(curve + np.diag(damping * diagonal), down)
            change[side, state.places] = -step
            gains.append(step @ (down - HALF * curve @ step))
        return _Trial(state.moved(change), max(gains) > BETTER)

    def _improve(self, state: State, other: State) -> bool:
        """Keep what is better of a trial; return whether another step may gain."""
        before, error = state.hypothesis.to_linear(state.values), state.replay.error
        state.gain = np.maximum(state.take(other, self.fold), 0.0)
        good, again = state.gain > self.settings.settled, not state.fresh
        if good.any():
            step = state.hypothesis.to_linear(other.values) - before
            state.learn(step, other.replay.error - error, self.fold)
            state.fresh = False
        elif again:
            state.slopes = None
            return True
        ratio = self.settings.damping_ratio
        shrunk = np.maximum(state.damping / ratio, self.settings.damping)
        state.damping = np.where(good, shrunk, state.damping * ratio)
        state.failed = np.where(good, 0, state.failed + 1)
        return bool(good.any() or (state.failed < FOLDS).any())

    def _finish(self, states: Sequence[State]) -> list[Fit]:
        """Return the fits, judged; what fits the other fold better than its own is taken over."""
        held = self._crossed(states)
        apart = [pair for pair in zip(states, held, strict=True) if pair[0].is_apart]
        jobs = [(state.hypothesis, state.values[::-1]) for state, _ in apart]
        again, swapped = [], self._make(jobs, [replay for _, replay in apart])
        for (state, _), other in zip(apart, swapped, strict=True):
            if (state.take(other, self.fold) > BETTER).any():
                again.append(state)
        anew = {id(s): replay for s, replay in zip(again, self._crossed(again), strict=True)}
        held = [anew.get(id(s), replay) for s, replay in zip(states, held, strict=True)]
        pairs = list(zip(states, held, strict=True))
        scores = together([partial(self._score, *pair) for pair in pairs])
        return [_as_fit(*pair, score) for pair, score in zip(pairs, scores, strict=True)]

    def _crossed(self, states: Sequence[State]) -> list[Replay]:
        """Return each state under the values of the other fold; where they agree, as it is."""
        apart = [state for state in states if state.is_apart]
        made = iter(self._replay([(s.hypothesis, s.values[::-1]) for s in apart]))
        held = {id(state): next(made) for state in apart}
        return [held.get(id(state), state.replay) for state in states]

    def _score(self, state: State, held: Replay) -> np.ndarray:
        """Return the score of a state, see `Fit`, from its replay under the other fold's values."""
        score = np.zeros(len(self.fold))
        for side in range(FOLDS):
            errors = self._seen_from(side, state.replay.error, held.error)
            other = self.sides[1 - side]
            projection = self.likelihood.project(errors)
            predicted = self.likelihood.predict(projection, state.trained[side])
            score[other] = (predicted - self.likelihood.charge(state.trained[side]))[other]
        return score

    def _seen_from(self, side: int, own: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the errors of all windows under the values of one fold, (W, N, M)."""
        return np.where((self.fold == side)[:, None, None], own, held)


class _Trial(NamedTuple):
    """Where a step leads, (2, P), and whether it promises a gain."""

    values: np.ndarray
    promises: bool


def _as_fit(state: State, held: Replay, score: np.ndarray) -> Fit:
    """Return a state as a fit, with its replay under the other fold's values and its score (W,)."""
    known = state.replay.error, held.error, tuple(state.trained), state.density, score
    return Fit(state.hypothesis, state.values, *known)
