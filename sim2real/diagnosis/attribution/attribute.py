"""Which effects are missing: fitted one by one, judged on what they were not fitted to.

    found = attribute(problem, candidates(data), floor, rng)
    found.fit.members, found.equivalent

Forward: every candidate is screened, the promising ones race (few steps for many, more for fewer),
and the best on held-out windows joins if the lower bound of its gain is above zero and it closes
enough to matter; a further one has to pay its price as well, or would go again in the end. Then
back: each member is taken out and may be replaced, or stays out (`looking_back`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.contenders import Contender, Found, Raced
from sim2real.diagnosis.attribution.fit import Fit, Job, columns, in_words, refine, refine_each
from sim2real.diagnosis.attribution.heats import Course, ahead, heats, looked_at
from sim2real.diagnosis.attribution.liveliest import lively, tempered
from sim2real.diagnosis.attribution.looking_back import look_back
from sim2real.diagnosis.attribution.pairwise import Pair, pairs
from sim2real.diagnosis.attribution.price import pays
from sim2real.diagnosis.attribution.problem import FOLDS, Problem
from sim2real.diagnosis.attribution.promise import Guess
from sim2real.diagnosis.attribution.quantify import without
from sim2real.diagnosis.attribution.screen import Response, Screening, screen
from sim2real.diagnosis.attribution.suspects import meets, suspects
from sim2real.diagnosis.attribution.ties import Witnessed
from sim2real.diagnosis.data.score import Blocks, coherence
from sim2real.diagnosis.settings import TINY_SQUARE

PAIRING, STARTED, CAUSE, ENDING = 0.3, 0.1, 0.25, 0.9  # shares of the work, for the progress

OnProgress = Callable[[str, float], None]


class Search:
    """The state of an attribution.

    Args:
        problem: all windows.
        options: the candidates.
        floor: noise floor, in the units of errors.
        rng: for the bootstrap.
        on_progress: called with what is tried, and the share of the work done.
        floors: of each joint, (M,); None: all alike.
        witnessed: effects that channels measured; of equals they go first.
        stand_ins: candidates for the places of the effects that they pass for alone.
    """

    def __init__(
        self,
        problem: Problem,
        options: Sequence[Candidate],
        floor: float,
        rng: np.random.Generator,
        on_progress: OnProgress,
        floors: np.ndarray | None = None,
        witnessed: Witnessed = frozenset(),
        stand_ins: Sequence[Candidate] = (),
    ) -> None:
        self.problem, self.floor, self.witnessed = problem, floor, witnessed
        self.options: Sequence[Candidate] = list(options)
        self.stand_ins = stand_ins
        self.work = problem.simulator.work
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
        self.raced: dict[frozenset[str], Raced] = {}  # by the labels of what it was beside
        self.rests: dict[frozenset[str], Raced] = {}  # fits of these effects alone; no race was run
        self.most = self.settings.causes_max
        self.enough = 0.0  # share of the gap that it must promise to close, or it ends
        self.best = ""  # what explains most so far, in words

    def run(self, most: int | None = None) -> Found:
        """Search for so many causes; None: for as many as the settings allow."""
        found = self.ahead(most)
        self.back(found)
        return found

    def ahead(self, most: int | None = None) -> Found:
        """Add causes one after the other; see `run`."""
        self.most, found = most or self.settings.causes_max, Found(self.none, self.base)
        while len(found.fit.members) < self.most:
            if len(found.fit.members) == 1:
                with self.work.during("pairs"):
                    self.pair(found)
            if found.fit.members and self.blocks.rms(found.error) <= self.least:
                break
            contenders = self.race(found.fit, found.error, found)
            best = contenders[0] if contenders else None
            if best is None or not self.joins(best, found, contenders):
                if not found.fit.members and self.couple(found):
                    continue
                break
            best = self.polish(best)
            if found.fit.members and not pays(self, found.error, best.error):
                break
            self.keep(found, best.fit, best.error)
            found.steps.append((best.candidate.label, best.error))
            found.rivals[best.candidate.label] = contenders
        return found

    def back(self, found: Found) -> None:
        """Look at each cause again beside all others, and fit what stays to the end."""
        if len(found.fit.members) > 1:
            with self.work.during("looking back"):
                look_back(self, found)
        if found.fit.members:
            with self.work.during("last fit"):
                self.settle(found)

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

    def couple(self, found: Found) -> bool:
        """Begin with two effects where none helps alone; return whether that was found to help.

        An error that grows fast where another effect is missing hides what the first one mends.
        """
        with self.work.during("pairs"):
            self.pair(found)
        return bool(found.fit.members)

    def pair(self, found: Found) -> None:
        """Put two effects in the place of the first, if they do far better together.

        Not where the first one alone closes the gap.
        """
        alone = self.blocks.rms(found.error)
        if alone <= self.least or self.closed(alone) > self.settings.alone:
            return
        (most, *fewer), made = self.settings.pairs, self.couples()
        if not made or not self.reaches(self.before, made[0].gain):
            return
        made = made[:most]
        jobs = [Job(pair.members, pair.start[None], 1) for pair in made]
        self.say(f"fitting {in_words(jobs)}", PAIRING)
        course = self.course(self.screening, self.racing, self.first.offset)
        fits = looked_at(jobs, course, refine_each)
        stages = (self.screening, self.racing, self.fitting)
        for count, problem in zip(fewer, stages, strict=True):
            fits = sorted(fits, key=lambda fit: float(fit.cost.sum()))[:count]
            jobs = [Job(fit.members, fit.values[None], 1) for fit in fits]
            fits = self._fits(problem, jobs, PAIRING)
        if not fits:
            return
        errors = self.problem.held_out_each(fits)
        made = [Contender(f.members[1], f, e) for f, e in zip(fits, errors, strict=True)]
        both = min(made, key=lambda one: self.blocks.rms(one.error))
        if self.joins(both, found, made):
            self.keep(found, both.fit, both.error)
            found.rivals = {}
            self.settle(found)
            found.steps.append((" and ".join(m.label for m in both.fit.members), found.error))

    def couples(self) -> list[Pair]:
        """Return two effects at once as the first screening promises them, the best first."""
        first = self.first
        return pairs(self.screening, first.base, first.drift, first.responses)

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
        replacing: Contender | None = None,
    ) -> list[Contender]:
        """Return the best candidates to add to a fit, the best on held-out windows first.

        With `replacing` only others that could take its place.
        """
        options, against = suspects(self, fit, error), None
        if replacing is not None:
            known, against = replacing.candidate, replacing.error
            options = [o for o in options if o.label != known.label and meets(o, known)]
        self.say(f"screening {len(options)} effects", self._share(fit))
        looked, racing = self.stages(error)
        with self.work.during("screening"):
            screening = self.screened(looked, fit, options)
        if found is not None and not fit.members:
            found.guesses, self.first = screening.guesses, screening
        guesses = self.promising(screening.guesses, fit)
        last = len(fit.members) + 1 >= self.most
        if last and guesses and not self.reaches(self.blocks.rms(error), guesses[0].gain):
            return []
        with self.work.during("race"):
            share, course = self._share(fit), self.course(looked, racing, screening.offset)
            on_fits = partial(self._fits, share=share)
            made = heats(guesses, fit, error, course, on_fits, against)
        with self.work.during("judging"):
            made = ahead(made, racing, error, self.settings.judged, against)
            parts = zip(made, self.problem.held_out_each(made), strict=True)
        contenders = [Contender(fit.members[-1], fit, wrong) for fit, wrong in parts]
        contenders.sort(key=lambda c: self.blocks.rms(c.error))
        if found is not None:
            self.raced[labels_of(fit.members)] = Raced(fit, error, contenders)
            found.singles = found.singles if fit.members else contenders
        return contenders

    def screened(self, looked: Problem, fit: Fit, options: Sequence[Candidate]) -> Screening:
        """Return a guess for each option; what was screened alone is not screened again."""
        if looked is self.screening and not fit.members and self.first.guesses:
            names, first = {option.label for option in options}, self.first
            guesses = [g for g in first.guesses if g.candidate.label in names]
            return first._replace(
                guesses=guesses,
                responses=[r for r in first.responses if r.candidate.label in names],
            )
        before = self.responses if looked is self.screening else ()
        coarse = None if self.coarse is None else looked.by(self.coarse)
        made = screen(looked, fit, options, before, coarse)
        if looked is self.screening:
            seen = {response.candidate.label for response in made.responses}
            self.responses = [r for r in self.responses if r.candidate.label not in seen]
            self.responses += made.responses
        return made

    def course(self, looked: Problem, racing: Problem, offset: np.ndarray | None) -> Course:
        """Return where to race; longer time steps are off by so much, (n, T, M), or None: lost."""
        if self.coarse is None or offset is None:
            return Course(looked, racing)
        return Course(looked, racing, looked.by(self.coarse, offset))

    def reaches(self, gap: float, gain: float) -> bool:
        """Return whether a search that needs that much may get there by what a gap promises."""
        return self.closed(gap * float(np.sqrt(max(1.0 - gain, 0.0)))) >= self.enough

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
        with self.work.during("winner's fit"):
            fit = refine(self.fitting, best.fit.members, starts, self.settings.settled_rounds)
            return self.judge(best.candidate, fit)

    def judge(self, candidate: Candidate, fit: Fit) -> Contender:
        """Return a fit with its errors on all held-out windows."""
        return Contender(candidate, fit, self.problem.held_out(fit.members, fit.values))

    def place_of(self, own: Contender) -> Raced:
        """Return who raced for a member's place, beside the others; the race is run if need be."""
        fit, member = own.fit, own.candidate
        known = self.raced.get(labels_of([m for m in fit.members if m is not member]))
        if known is not None:
            met = [c for c in known.contenders if meets(c.candidate, member)]
            return known._replace(contenders=met)
        rest = self.rest(fit, member)
        return rest._replace(contenders=self.race(rest.fit, rest.error, replacing=own))

    def rest(self, fit: Fit, member: Candidate) -> Raced:
        """Return the fit of all members but one, with its held-out errors; it is made once."""
        labels = labels_of([m for m in fit.members if m is not member])
        known = self.raced.get(labels) or self.rests.get(labels)
        if known is None:
            rest = self.without(fit, member)
            error = self.problem.held_out(rest.members, rest.values)
            self.rests[labels] = known = Raced(rest, error, [])
        return known

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


def labels_of(members: Sequence[Candidate]) -> frozenset[str]:
    """Return the labels of some effects: what a race was run beside."""
    return frozenset(member.label for member in members)


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
