"""Heats of a race: many candidates are simulated a little, fewer are fitted, and few go on.

    rough = Rough(looked.by(coarse), offset)        # or None: there are no longer steps
    course = Course(looked, racing, rough)
    fits = heats(guesses, fit, error, course, on_fits)                      # the best first

A first heat without steps of a fit asks for an order alone. It is held in longer time steps for
what these do not hide: the simulation as it is, and how it changes in longer steps. Who is left is
simulated as it is before anybody takes a step. Where the best one closes most of the gap, who
closes next to nothing of it does not go on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.fit import Fit, Job
from sim2real.diagnosis.attribution.problem import FOLDS, Problem
from sim2real.diagnosis.attribution.promise import Guess
from sim2real.diagnosis.attribution.screen import Kind, kind_of

OnFits = Callable[[Problem, Sequence[Job]], list[Fit]]  # makes fits, and tells that it does


class Course(NamedTuple):
    """Where a race is run."""

    looked: Problem  # the screened windows
    racing: Problem  # those that values are fitted to
    rough: Problem | None = None  # the screened windows in longer time steps; None: there are none


def heats(
    guesses: Sequence[Guess],
    fit: Fit,
    error: np.ndarray,
    course: Course,
    on_fits: OnFits,
    against: np.ndarray | None = None,
) -> list[Fit]:
    """Return the fits of the guesses that are left in the end, the best first.

    Args:
        guesses: who races, the most promising first.
        fit: what is known already, and fitted along.
        error: what is wrong beside it, (W, T, M).
        course: the windows.
        on_fits: makes the fits.
        against: errors with the one whose place is raced for, (W, T, M); None: the place is free.
    """
    settings = course.looked.data.settings.search
    fits: dict[str, Fit] = {}
    runners = list(guesses)
    for number, (count, rounds) in enumerate(settings.race):
        runners = runners[:count]
        jobs = [job(fit, g, fits.get(g.candidate.label), rounds, settings.spread) for g in runners]
        if rounds:
            done = on_fits(course.racing, jobs)
        else:
            where = course if number == 0 else course._replace(rough=None)
            done = looked_at(jobs, where, on_fits, len(fit.members))
        fits |= {g.candidate.label: one for g, one in zip(runners, done, strict=True)}
        runners.sort(key=lambda guess: float(fits[guess.candidate.label].cost.sum()))
        problem = course.racing if rounds else course.looked
        made = [fits[guess.candidate.label] for guess in runners]
        runners = runners[: len(ahead(made, problem, error, settings.lagging, against))]
    return [fits[guess.candidate.label] for guess in runners]


def ahead(
    fits: Sequence[Fit],
    problem: Problem,
    error: np.ndarray,
    share: float,
    against: np.ndarray | None = None,
) -> Sequence[Fit]:
    """Return the fits that close at least a share of what the best one closes.

    All of them where that is little itself, and says nothing of the others.

    Args:
        fits: on the problem's windows, the best first.
        problem: the windows.
        error: what is wrong without any of them, (W, T, M).
        share: of the fall of the gap's root mean square by the best one.
        against: errors with another one, which may be the best, (W, T, M); None: there is none.
    """
    before, *known = (_size(problem, e) for e in (error, against) if e is not None)
    falls = [before - float(np.sqrt(fit.cost.sum())) for fit in fits]
    best = max([*falls, *(before - one for one in known)], default=0.0)
    if best < problem.data.settings.search.judged * before:
        return fits
    return [fit for fit, fall in zip(fits, falls, strict=True) if fall >= share * best]


def _size(problem: Problem, error: np.ndarray) -> float:
    """Return the root of the cost of errors of all windows, (W, T, M), on a problem's windows."""
    seen = problem.seen(error)
    return float(np.sqrt(problem.cost(seen, np.zeros_like(seen)).sum()))


def looked_at(jobs: Sequence[Job], course: Course, on_fits: OnFits, known: int = 0) -> list[Fit]:
    """Return the fits of jobs to the screened windows: in longer time steps where these will do.

    Args:
        jobs: the fits.
        course: the windows.
        on_fits: makes the fits.
        known: so many members of each are known already.
    """
    if course.rough is None:
        return on_fits(course.looked, jobs)
    long = [all(map(softened, job.members[known:])) for job in jobs]
    done = {
        own: iter(on_fits(problem, [j for j, one in zip(jobs, long, strict=True) if one == own]))
        for own, problem in ((True, course.rough), (False, course.looked))
    }
    return [next(done[own]) for own in long]


def softened(candidate: Candidate) -> bool:
    """Return whether longer time steps keep what a candidate does."""
    return kind_of(candidate.effect) is Kind.LONG


def job(fit: Fit, guess: Guess, before: Fit | None, rounds: int, spread: Sequence[float]) -> Job:
    """Return the fit of a guess beside the effects found, from its starts or where it was.

    Args:
        fit: the effects found.
        guess: what is added.
        before: its last fit; None: it has none, and starts from multiples of its guess.
        rounds: steps of the fit at most.
        spread: these multiples.
    """
    candidate = guess.candidate
    members = (*fit.members, candidate)
    if before is not None:
        return Job(members, before.values[None], rounds)
    starts = [
        np.concatenate([guess.known, np.tile(candidate.towards(guess.start, s), (FOLDS, 1))], 1)
        for s in spread
    ]
    return Job(members, np.array(starts), rounds)
