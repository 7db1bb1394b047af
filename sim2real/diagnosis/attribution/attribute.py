"""Which effects are missing: fitted one by one, judged on what they were not fitted to.

    found = attribute(problem, candidates(data), floor, rng)
    found.fit.members, found.equivalent

Forward: every candidate is screened, the promising ones race (few steps for many, more for fewer),
and the best on held-out windows joins if the lower bound of its gain is above zero and it closes
enough to matter; a further one has to pay its price as well, or would go again in the end. Then
back: each member is taken out and may be replaced, or stays out.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from envs.effects.base import PLAIN
from sim2real.diagnosis.attribution.candidates import Candidate, in_the_way
from sim2real.diagnosis.attribution.cogging import with_ripples
from sim2real.diagnosis.attribution.fit import (
    FOLDS,
    Fit,
    Job,
    Problem,
    columns,
    in_words,
    refine,
    refine_each,
)
from sim2real.diagnosis.attribution.liveliest import lively, tempered
from sim2real.diagnosis.attribution.pairwise import pairs
from sim2real.diagnosis.attribution.price import pays
from sim2real.diagnosis.attribution.promise import Guess
from sim2real.diagnosis.attribution.quantify import without
from sim2real.diagnosis.attribution.screen import Response, Screening, screen
from sim2real.diagnosis.data.score import Blocks, coherence
from sim2real.diagnosis.settings import TINY_SQUARE

PAIRING, STARTED, CAUSE, ENDING = 0.3, 0.1, 0.25, 0.9  # shares of the work, for the progress

OnProgress = Callable[[str, float], None]


class Contender(NamedTuple):
    """A candidate fitted beside the effects found so far, and its held-out errors.

    One that raced took few steps beside what was then known; one that is `settled` as many as the
    causes, beside all others: only equals are compared with each other.
    """

    candidate: Candidate
    fit: Fit
    error: np.ndarray  # (W, T, M)
    settled: bool = False


@dataclass
class Found:
    """What attribution came to.

    Args:
        fit: the causes and their values.
        error: held-out errors with all of them, (W, T, M).
        steps: held-out errors after each effect was added, with its label.
        rivals: for each cause, the contenders for its place, the best first.
        guesses: what screening made of every candidate, alone.
        singles: candidates that were fitted alone.
        seen: the rows on which rivals are compared, (W, T, 1); None for all.
    """

    fit: Fit
    error: np.ndarray
    steps: list[tuple[str, np.ndarray]] = field(default_factory=list)
    rivals: dict[str, list[Contender]] = field(default_factory=dict)
    guesses: list[Guess] = field(default_factory=list)
    singles: list[Contender] = field(default_factory=list)
    seen: np.ndarray | None = None

    def on(self, error: np.ndarray) -> np.ndarray:
        """Return errors on the rows on which rivals are compared, zeros elsewhere, (W, T, M)."""
        return error if self.seen is None else np.where(self.seen, error, 0.0)


class Search:
    """The state of an attribution.

    Args:
        problem: all windows.
        options: the candidates.
        floor: noise floor, in the units of errors.
        rng: for the bootstrap.
        on_progress: called with what is tried, and the share of the work done.
        floors: of each joint, (M,); None: all alike.
    """

    def __init__(
        self,
        problem: Problem,
        options: Sequence[Candidate],
        floor: float,
        rng: np.random.Generator,
        on_progress: OnProgress,
        floors: np.ndarray | None = None,
    ) -> None:
        self.problem, self.options, self.floor = problem, list(options), floor
        self.floors = np.full(len(problem.data.joints), floor) if floors is None else floors
        self.on_progress = on_progress
        self.rng = rng
        self.settings = limits = problem.data.settings.search
        self.none = Fit((), np.zeros((FOLDS, 0)), np.zeros(FOLDS))
        self.base = problem.held_out((), self.none.values)
        weight = tempered(problem.data, self.base)

        def liveliest(seconds: float) -> np.ndarray:
            return lively(problem.data, self.base, seconds)

        self.fitting = problem.subset(liveliest(limits.fitting_s))
        self.settling = problem.subset(liveliest(limits.final_s))
        self.racing = problem.subset(liveliest(limits.racing_s), weight)
        self.screening = problem.subset(liveliest(limits.screening_s), weight)
        longer = problem.data.stepping(problem.data.settings.screening.coarse_s)
        self.coarse = None if longer is None else problem.simulator.of(longer)
        seconds = coherence(problem.data, self.base)
        self.blocks = Blocks(problem.data, problem.windows, rng, seconds)
        self.before = self.blocks.rms(self.base)
        counts = np.array([joint.count / joint.scale for joint in problem.data.joints])
        rounded = float(np.sqrt(np.mean(counts**2)))
        self.least = max(limits.done_floors * floor, rounded)  # nothing is left then
        self.first = Screening([], [], self.base, self.base)
        self.responses: list[Response] = []  # of each candidate, as last screened
        self.best = ""  # what explains most so far, in words

    def run(self, most: int | None = None) -> Found:
        """Search for so many causes; None: for as many as the settings allow."""
        found = Found(self.none, self.base)
        while len(found.fit.members) < (most or self.settings.causes_max):
            if len(found.fit.members) == 1:
                self.pair(found)
            contenders = self.race(found.fit, found.error, found)
            best = contenders[0] if contenders else None
            if best is None or not self.joins(best, found, contenders):
                break
            best = self.polish(best)
            if found.fit.members and not pays(self, found.error, best.error):
                break
            self.keep(found, best.fit, best.error)
            found.steps.append((best.candidate.label, best.error))
            found.rivals[best.candidate.label] = contenders
            if self.blocks.rms(found.error) <= self.least:
                break
        if len(found.fit.members) > 1:
            self.look_back(found)
        if found.fit.members:
            self.settle(found)
        return found

    def say(self, text: str, share: float) -> None:
        """Tell what is being tried, beside the best so far, and the share of the work done."""
        self.on_progress(f"{text}{self.best}", share)

    def keep(self, found: Found, fit: Fit, error: np.ndarray) -> None:
        """Let a fit with its held-out errors be the best so far."""
        found.fit, found.error = fit, error
        names, closed = [m.label for m in fit.members], self.closed(self.blocks.rms(error))
        self.best = f" (best so far: {', '.join(names) or 'nothing'}, {closed:.0%} closed)"

    def settle(self, found: Found) -> None:
        """Fit what was found to more windows and to the end, unless little is left as it is.

        Each fold starts from its own values, from the other one's and from between: several
        effects together may have settled beside the best in one of them.
        """
        if self.blocks.rms(found.error) <= self.least:
            return
        values = found.fit.values
        between = np.repeat(found.fit.mean[None], FOLDS, axis=0)
        starts = np.stack([values, values[::-1], between])
        fit = refine(self.settling, found.fit.members, starts, self.settings.final_rounds)
        error = self.problem.held_out(fit.members, fit.values)
        if self.blocks.rms(error) < self.blocks.rms(found.error):
            self.keep(found, fit, error)

    def pair(self, found: Found) -> None:
        """Put two effects in the place of the first, if they do far better together.

        Not where the first one alone closes the gap.
        """
        alone = self.blocks.rms(found.error)
        if alone <= self.least or self.closed(alone) > self.settings.alone:
            return
        first, (most, *fewer) = self.first, self.settings.pairs
        jobs = [
            Job(pair.members, pair.start[None], 1)
            for pair in pairs(self.screening, first.base, first.drift, first.responses)[:most]
        ]
        fits = self._fits(self.screening, jobs, PAIRING)
        stages = (self.screening, self.racing, self.fitting)
        for count, problem in zip(fewer, stages, strict=True):
            fits = sorted(fits, key=lambda fit: float(fit.cost.sum()))[:count]
            jobs = [Job(fit.members, fit.values[None], 1) for fit in fits]
            fits = self._fits(problem, jobs, PAIRING)
        if not fits:
            return
        error = self.problem.held_out(fits[0].members, fits[0].values)
        both = Contender(fits[0].members[1], fits[0], error)
        if self.joins(both, found):
            self.keep(found, both.fit, both.error)
            found.rivals = {}
            self.settle(found)
            found.steps.append((" and ".join(m.label for m in fits[0].members), found.error))

    def closed(self, gap: float) -> float:
        """Return the share of the closable gap that is closed where this gap remains."""
        return (self.before - gap) / max(self.before - self.floor, TINY_SQUARE)

    def joins(self, best: Contender, found: Found, contenders: Sequence[Contender] = ()) -> bool:
        """Return whether an effect's held-out gain is sure, and large enough to matter.

        The winner of a race pays for all the contenders that it was picked from.
        """
        fall = self.blocks.rms(found.error) - self.blocks.rms(best.error)
        limits, room = self.settings, self.before - self.floor
        least = max(limits.worth_floors * self.floor, limits.worth * room)
        others = [c.error for c in contenders if c is not best]
        return fall > least and self.blocks.best_gain(found.error, [best.error, *others]) > 0

    def race(
        self,
        fit: Fit,
        error: np.ndarray,
        found: Found | None = None,
        replacing: Candidate | None = None,
    ) -> list[Contender]:
        """Return the best candidates to add to a fit, the best on held-out windows first.

        With `replacing` only those that could take its place.
        """
        options = self.suspects(fit, error)
        if replacing is not None:
            options = [option for option in options if meets(option, replacing)]
        self.say(f"screening {len(options)} effects", self._share(fit))
        looked, racing = self.stages(error)
        before = self.responses if looked is self.screening else ()
        coarse = None if self.coarse is None else looked.by(self.coarse)
        screening = screen(looked, fit, options, before, coarse)
        if looked is self.screening:
            seen = {response.candidate.label for response in screening.responses}
            self.responses = [r for r in self.responses if r.candidate.label not in seen]
            self.responses += screening.responses
        if found is not None and not fit.members:
            found.guesses, self.first = screening.guesses, screening
        runners = self.promising(screening.guesses, fit)[: self.settings.race[0][0]]
        fits = {}
        for count, rounds in self.settings.race:
            runners = runners[:count]
            problem = racing if rounds else looked
            jobs = [self.job(fit, g, fits.get(g.candidate.label), rounds) for g in runners]
            done = self._fits(problem, jobs, self._share(fit))
            fits |= {g.candidate.label: one for g, one in zip(runners, done, strict=True)}
            runners.sort(key=lambda guess: float(fits[guess.candidate.label].cost.sum()))
        made = [fits[guess.candidate.label] for guess in runners]
        parts = zip(made, self.problem.held_out_each(made), strict=True)
        contenders = [Contender(fit.members[-1], fit, wrong) for fit, wrong in parts]
        contenders.sort(key=lambda c: self.blocks.rms(c.error))
        if found is not None and not fit.members:
            found.singles = contenders
        return contenders

    def stages(self, error: np.ndarray) -> tuple[Problem, Problem]:
        """Return the windows to screen and to race on: the first ones, if these errors show there.

        Windows that are full of a first effect may say nothing of a second one. A race looks at
        both kinds, or it would spoil what was found.
        """
        data = self.problem.data
        size = data.window_squares(error)
        worst = lively(data, error, self.settings.screening_s)
        if size[self.screening.windows].mean() >= self.settings.shown * size[worst].mean():
            return self.screening, self.racing
        weight = tempered(data, error)
        both = np.union1d(self.screening.windows, lively(data, error, self.settings.racing_s))
        return self.problem.subset(worst, weight), self.problem.subset(both, weight)

    def promising(self, guesses: Sequence[Guess], fit: Fit) -> list[Guess]:
        """Return the guesses that would matter if they held what they promise."""
        limits = self.settings
        least = limits.promise_later if fit.members else limits.promise_first
        return [guess for guess in guesses if guess.gain > least]

    def polish(self, best: Contender) -> Contender:
        """Return the winner fitted on more windows, from where it is and from further scalars."""
        further = beside(best, self.settings.spread)
        starts = np.concatenate([best.fit.values[None], further])
        fit = refine(self.fitting, best.fit.members, starts, self.settings.settled_rounds)
        return self.judge(best.candidate, fit)

    def job(self, fit: Fit, guess: Guess, before: Fit | None, rounds: int) -> Job:
        """Return the fit of a guess beside the effects found, from its start or where it was."""
        candidate = guess.candidate
        members = (*fit.members, candidate)
        if before is not None:
            return Job(members, before.values[None], rounds)
        starts = [
            np.concatenate([guess.known, np.tile(candidate.towards(guess.start, s), (FOLDS, 1))], 1)
            for s in self.settings.spread
        ]
        return Job(members, np.array(starts), rounds)

    def judge(self, candidate: Candidate, fit: Fit) -> Contender:
        """Return a fit with its errors on all held-out windows."""
        return Contender(candidate, fit, self.problem.held_out(fit.members, fit.values))

    def suspects(self, fit: Fit, error: np.ndarray) -> list[Candidate]:
        """Return the candidates that could cause what is wrong: at joints with a gap, or above.

        What all joints share, and takes its time to simulate, only if several have one.
        """
        taken = {(m.name, m.effect.where) for m in fit.members}
        square = self.problem.data.mean_squares(error)
        excess = np.maximum(square - self.floor**2, 0.0)
        names = [joint.name for joint in self.problem.data.joints]
        least = self.settings.suspect * max(excess.sum(), TINY_SQUARE)
        guilty = {name for name, e in zip(names, excess, strict=True) if e > least}
        found = [
            option
            for option in self.options
            if (option.name, option.effect.where) not in taken
            and not any(in_the_way(option.effect, m.effect) for m in fit.members)
            and (option.joint is None or guilty & set(option.shown))
            and (len(guilty) > 1 or not option.shared or option.group == PLAIN)
        ]
        return [
            with_ripples(option, self.problem.data, error) if option.name == "cogging" else option
            for option in found
        ]

    def look_back(self, found: Found) -> None:
        """Take each member out: let another one take its place if it does better, or none."""
        for member in sorted(found.fit.members, key=lambda m: found.fit.members.index(m)):
            if len(found.fit.members) <= 1:
                return
            rest = self.without(found.fit, member)
            error = self.problem.held_out(rest.members, rest.values)
            others = self.race(rest, error, replacing=member)
            others = [other for other in others if other.candidate.label != member.label]
            contenders = [Contender(member, found.fit, found.error), *others]  # it has settled
            contenders.sort(key=lambda c: self.blocks.rms(c.error))
            best = contenders[0]
            dropped = Found(rest, error)
            if not self.joins(best, dropped, contenders):
                self.keep(found, rest, error)
                found.rivals.pop(member.label, None)
                continue
            if best.candidate is not member:
                best = self.polish(best)
            self.keep(found, best.fit, best.error)
            found.rivals.pop(member.label, None)
            found.rivals[best.candidate.label] = contenders

    def without(self, fit: Fit, member: Candidate) -> Fit:
        """Return the fit of all members but one."""
        rest = without(fit, [i for i, m in enumerate(fit.members) if m is not member])
        return refine(self.fitting, rest.members, rest.values[None], self.settings.rest_rounds)

    def _fits(self, problem: Problem, jobs: Sequence[Job], share: float) -> list[Fit]:
        """Tell what is being fitted, and fit it."""
        self.say(f"fitting {in_words(jobs)}", share)
        return refine_each(problem, jobs)

    def _share(self, fit: Fit) -> float:
        return min(STARTED + CAUSE * len(fit.members), ENDING)


def meets(one: Candidate, other: Candidate) -> bool:
    """Return whether there is a joint whose motion both change."""
    everywhere = one.joint is None or other.joint is None
    return everywhere or not set(one.shown).isdisjoint(other.shown)


def beside(best: Contender, spread: Sequence[float]) -> np.ndarray:
    """Return the values of a fit with its newest member's further scalars as probed, (K, 2, P).

    Steps along a slope do not get from one of them to another: where it swings freely, a joint that
    rubs with any load is far from one that does not rub at all.
    """
    option = best.candidate
    own = columns(best.fit.members)[best.fit.members.index(option)]
    size = len(option.neutral) - len(option.effect.free)
    found = []
    for further in np.unique(option.probes[:, size:], axis=0) if option.effect.free else ():
        for scale in spread:
            values = best.fit.values.copy()
            values[:, own] = [option.towards(row, scale) for row in values[:, own]]
            values[:, own.start + size : own.stop] = further
            found.append(values)
    return np.array(found).reshape(len(found), *best.fit.values.shape)
