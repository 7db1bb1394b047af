"""The judge: which explanation predicts held-out stretches best, and whether that is enough.

    judge = Judge(data, fixed, rng)
    judgement = judge.judge(Vocabulary(data))
    judgement.verdict, judgement.best.label

Every change of the robot, its log and its world is looked at in part of the windows; those that
promise most are fitted, and scored alike, the null explanations with them. The best grows by one
member as long as each wins what the tolerance asks for, and loses those that do not. What is
unknown of starts, clocks and parameters is computed around it anew each time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from envs.plant import Fixed
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.progress import Moving
from sim2real.diagnosis.data.simulate import Work
from sim2real.diagnosis.inference.criteria import Criteria
from sim2real.diagnosis.inference.decision import Standing, compute_posterior, decide_verdict
from sim2real.diagnosis.inference.distance import share_joint, stands_alone
from sim2real.diagnosis.inference.episodes import follows_episodes
from sim2real.diagnosis.inference.events import Event, find_events
from sim2real.diagnosis.inference.fit import Fit, Fitter, Start
from sim2real.diagnosis.inference.hypotheses import NONE, Hypothesis
from sim2real.diagnosis.inference.likelihood import Basis
from sim2real.diagnosis.inference.moves import (
    is_part,
    list_shorter,
    list_simpler,
    make_start,
    pick_distinct,
    rank_fits,
    restart,
)
from sim2real.diagnosis.inference.replayer import Job, Replayer
from sim2real.diagnosis.inference.score import FOLDS, Bootstrap, deal_folds
from sim2real.diagnosis.inference.search import Search, is_better, keep_better
from sim2real.diagnosis.inference.unknowns import coarsen, make_fitter
from sim2real.diagnosis.inference.vocabulary import Vocabulary
from sim2real.diagnosis.schema import Verdict

SHARES = (0.05, 0.3, 0.5, 0.6, 0.7)  # of the work that is done, by the members that are known
SURE = 4.0  # noises or counts that an error of noise alone does not reach


@dataclass(frozen=True)
class Judgement:
    """What the judge says."""

    verdict: Verdict  # see `decision`
    best: Fit  # the explanation; the model as given where there is none
    given: Fit  # the model as given
    rivals: tuple[Fit, ...]  # other explanations that were fitted to the end, the best first
    events: tuple[Event, ...]  # that happen once and hold most of what is left
    probability: np.ndarray  # (1 + n,) of the best and of each rival
    unknown: float  # probability of a law that is not in the vocabulary
    imitators: tuple[Fit, ...]  # explanations with an effect that is excluded, which do as well
    judge: Judge  # who said so


class Judge(Criteria):
    """Judges explanations of the gap in some windows; the rest is as in `run.About`."""

    def __init__(
        self,
        data: Data,
        fixed: Sequence[Fixed] = (),
        rng: np.random.Generator | None = None,
        work: Work | None = None,
        moving: Moving | None = None,
    ) -> None:
        self.data, self._rest = data, (tuple(fixed), work)
        self.moving = Moving(lambda text, share: None) if moving is None else moving
        rng = rng or np.random.default_rng(0)
        bootstrap = Bootstrap(data.windows, rng, data.settings.inference)
        super().__init__(Replayer(data, *self._rest), bootstrap)
        self.fold = deal_folds(data.windows)
        self.basis: Basis | None = None
        every = self.replayer.every
        (given,) = self.replayer.replay([Job(NONE, np.zeros((len(every), 0)), every)])
        self.coarse = coarsen(self.replayer, given.error, every)
        unknown = self._look(NONE, np.zeros((FOLDS, 0)))
        self.search = Search(self, self.coarse, *unknown)

    def judge(self, vocabulary: Vocabulary) -> Judgement:
        """Return the judgement on the gap, which a vocabulary may explain."""
        tried = self.find(vocabulary)
        return self.conclude(tried, vocabulary.list_excluded(self.replay_errors(self.given)))

    def find(self, vocabulary: Vocabulary) -> dict[str, Fit]:
        """Return what was fitted to explain the gap, by label; `choose` says which wins."""
        tried, self.choices = {self.given.label: self.given}, vocabulary.choices
        self._world = vocabulary.robot  # whether it may have pushed the robot
        best = self._begin([make_start(change) for change in vocabulary.shown], tried)
        while len(best.hypothesis.members) < self.settings.members_max and not self.is_enough(best):
            added = f" in addition to {best.label}" if best.hypothesis.members else ""
            self.moving(f"looking at every change{added}", SHARES[len(best.hypothesis.members)])
            best = self.search.anchor(best, tried)
            starts = vocabulary.list_starts(self.replay_errors(best), self.find_open(best))
            self.search.refine(best, starts, tried)
            self._judge_mended(tried)
            before, best = best, self.choose(tried)
            self.search.elaborate(best, tried)
            best = self.choose(tried)
            if not self.is_enough(best):
                self.search.untie(best, vocabulary.effects, tried)
                self.search.look_closer(before, tried)
                best = self.choose(tried)
            if len(best.hypothesis.members) <= len(before.hypothesis.members):
                break
            best = self._renew(best, tried)
        return tried

    def _begin(self, shown: Sequence[Start], tried: dict[str, Fit]) -> Fit:
        """Return what the search starts from: the log as given, or as its own columns say it is.

        What the log shows of itself is no guess about the robot, and comes first: an effect that
        imitates it would leave the log's columns at odds.
        """
        for fit in self.fitter.fit(shown):
            if self.wins(self._judge_apart(fit, self.given), self.given):
                tried[fit.label] = fit
                return self._renew(fit, tried)
        return self.given

    def _renew(self, best: Fit, tried: dict[str, Fit]) -> Fit:
        """Return the best, fitted anew; judge what was tried by the unknowns around it, in place.

        Those around another model say little of what is left: they hide a second cause.
        """
        self.search.renew(*self._look(best.hypothesis, best.values))
        for label, fit in tried.items():
            tried[label] = self.fitter.judge(fit.hypothesis, fit.values, (fit.own, fit.held))
        tried[self.given.label] = self.given
        keep_better(self.fitter.fit([restart(tried[best.label])]), tried)
        return tried[best.label]

    def replay_errors(self, fit: Fit) -> np.ndarray:
        """Return the held-out errors of all rows, (W, T, M), of a fit."""
        return self.replayer.follow(fit.hypothesis, fit.values[1 - self.fold])[0]

    def excess(self, errors: np.ndarray) -> np.ndarray:
        """Return by how much squared errors exceed what noise and counts make, (W, N, M) both."""
        counts = SURE * self.most * self.replayer.noise
        beyond = np.square(errors / counts) - 1.0
        return np.where(self.replayer.used[..., None], np.maximum(beyond, 0.0), 0.0)

    def _look(self, hypothesis: Hypothesis, values: np.ndarray) -> list[np.ndarray]:
        """Take the likelihood whose starts and usual errors are those under a hypothesis.

        Return what is unknown around its errors under values (2, P) of the folds; see `unknowns`.
        """
        fitter, *unknown = self._make(hypothesis, values)
        self._around, self.basis = hypothesis.label, fitter.likelihood.basis
        self._apart: set[str] = set()  # labels of what was judged by unknowns of its own instead
        self.use(fitter)
        paths, none = (self.replayer.holding(), self.replayer.coasting()), np.zeros((FOLDS, 0))
        self.nulls = [self.fitter.judge(NONE, none, (errors, errors)) for errors in paths]
        return unknown

    def _prune(self, tried: dict[str, Fit], fitter: Fitter) -> Fit:
        """Return the best explanation, each of whose members wins what it has to.

        What predicts better and is too long is pruned, too: it may be right but for one member.
        """
        best, pruned, top = self.choose(tried), set[Fit](), rank_fits([*tried.values()])[0]
        while longer := [fit for fit in dict.fromkeys((best, top)) if fit not in pruned]:
            fewer = [short for fit in longer for short in list_shorter(fit)]
            pairs = zip(fewer, fitter.fit(fewer, rounds=0), strict=True)
            keep_better(fitter.fit([s for s, f in pairs if is_better(f, tried)]), tried)
            best, pruned = self.choose(tried), pruned.union(longer)
        return best

    def _swap(self, best: Fit, tried: dict[str, Fit]) -> Fit:
        """Return the best, once nothing that does about the same as one of its members is better.

        Beside a new member the others are compared anew: what comes first depends on the rest.
        """
        seen = {self.given.label}
        while best.label not in seen:
            seen.add(best.label)
            self.search.swap(best, tried)
            best = self._prune(tried, self.search.quick)
        return best

    def conclude(self, tried: dict[str, Fit], excluded: Sequence[Start] = ()) -> Judgement:
        """Return the judgement, with starts and usual errors as they are under the answer.

        What `find` returned is concluded once, since the search's memory is freed. Changes that are
        excluded explain nothing, but may do as well as the answer.
        """
        best, imitators = self._prune(tried, self.search.quick), []
        best = self._swap(best, tried)
        if best.hypothesis.members:
            if excluded:
                imitators = self.search.imitate(self.search.anchor(best, tried), excluded)
            del self.search  # its likelihoods are large, and another one follows
            self.moving(f"fitting {best.label} and its rivals once more", SHARES[-1])
            best, tried = self._refit(best, tried)
        fits = [self._judge_apart(fit, best) for fit in self.fitter.fit(map(restart, imitators))]
        imitators = [fit for fit in fits if not self.distance.distinguishes(best, fit)]
        verdict, events = self._decide(best, tried, not imitators), ()
        if verdict != "explained" and self.explains(self.given):
            best, verdict = self.given, "no_gap"  # what explains a part of no gap is no cause
        left = self.left(best)
        causes = self._world and (verdict != "unexplained" or best is self.given)
        if causes and left.whole > self.settings.equivalence_tolerance:
            beyond = (self.excess(fit.held) for fit in (best, self.given))
            events = find_events(self.fitter, best, *beyond)
            verdict = "partly_explained" if events else verdict
        rivals = rank_fits([f for f in tried.values() if f is not best and f.hypothesis.members])
        chances, unknown = compute_posterior(
            [(fit.total - self.given.total) / self.rows for fit in (best, *rivals)],
            [self.price(fit.hypothesis) for fit in (best, *rivals)],
            left.gain.total * len(self.most),
            self.settings,
        )
        known = verdict, best, self.given, tuple(rivals), events, chances, unknown
        return Judgement(*known, tuple(imitators), self)

    def _decide(self, best: Fit, tried: dict[str, Fit], alone: bool) -> Verdict:
        """Return the verdict on the best of what was tried; alone: nothing excluded imitates it."""
        members = best.hypothesis.members
        over = [*self.nulls, *([self.given] if members else [])]
        low, high = best.hypothesis.bounded(self.settings.implausible)
        inside = (best.values > low) & (best.values < high)
        left = self.left(best)
        standing = Standing(
            len(members),
            left,
            [self.bootstrap.gain(best.score - other.score) for other in over],
            bool(inside[:, best.hypothesis.smooth].all()),
            follows_episodes(self.data, best, *self._rest),
            alone
            and not share_joint(best.hypothesis, len(self.data.joints))
            and stands_alone(best, [*tried.values()], partial(self.distance.distinguishes, best)),
        )
        return decide_verdict(standing, self.settings)

    def _refit(
        self, best: Fit, tried: dict[str, Fit], again: bool = True
    ) -> tuple[Fit, dict[str, Fit]]:
        """Return the best and its nearest rivals, fitted where the answer is the model.

        The best that leaves the log as it is is one: those that mend it may be scored by unknowns
        around the answer already, the others by those around the model as given. A simpler law may
        have stopped short of where the best has moved to: it is tried there, too.
        """
        most, others = len(best.hypothesis.members), [f for f in tried.values() if f is not best]
        others = rank_fits([f for f in others if 0 < len(f.hypothesis.members) <= most])
        parts = [f for f in others if is_part(f.hypothesis, best.hypothesis)]
        parts += [f for f in others if not f.hypothesis.mended][:1]
        finalists = pick_distinct([best, *others[: self.settings.rivals], *parts], len(tried))
        if self._around != best.label:
            self._look(best.hypothesis, best.values)
        fits = self.fitter.fit(map(restart, finalists))
        refitted = {fit.label: self._judge_apart(fit, best) for fit in [self.given, *fits]}
        simpler = list_simpler(
            self.choose(refitted), (one for fit in fits for one in fit.hypothesis.members)
        )
        keep_better([self._judge_apart(f, best) for f in self.fitter.fit(simpler)], refitted)
        found = self._prune(refitted, self.fitter)
        if found.hypothesis.mended == best.hypothesis.mended:
            return found, refitted
        return self._refit(found, tried, again=False) if again else (refitted[best.label], refitted)

    def _judge_apart(self, fit: Fit, best: Fit) -> Fit:
        """Return a fit, with unknowns of its own if it mends the log otherwise than the best does.

        Windows of another log start elsewhere: what is unknown of one start says nothing of both.
        """
        if fit.hypothesis.mended == best.hypothesis.mended:
            return fit
        own, *_ = self._make(fit.hypothesis, fit.values)
        (fit,) = own.fit([restart(fit)], rounds=0)
        self.distance.score(own, fit)
        return fit

    def _judge_mended(self, tried: dict[str, Fit]) -> None:
        """Judge the best of what was tried by unknowns of its own if it mends the log, in place.

        So is the best that leaves the log as it is: else those around another model part the two.
        """
        ranked = rank_fits([fit for fit in tried.values() if fit.hypothesis.members])
        if ranked and ranked[0].label not in self._apart and ranked[0].hypothesis.mended:
            plain = [fit for fit in ranked if not fit.hypothesis.mended]
            for fit in [ranked[0], *plain[:1]]:
                self._apart.add(fit.label)
                own, *_ = self._make(fit.hypothesis, fit.values)
                (tried[fit.label],) = own.fit([restart(fit)], rounds=0)

    def _make(
        self, hypothesis: Hypothesis, values: np.ndarray
    ) -> tuple[Fitter, np.ndarray, np.ndarray]:
        return make_fitter(self.replayer, self.coarse, self.fold, hypothesis, values, self.basis)
