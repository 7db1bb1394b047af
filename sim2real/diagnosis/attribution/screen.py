"""Which candidates are worth a fit: how their probes change the simulation, scaled to the error.

    screening = screen(problem, found, candidates)      # beside what is found already
    for guess in screening.guesses: ...                 # promising first

A fit moves a candidate step by step; a screening looks at all of them with two or three simulations
each, and takes what lies between the probes for a straight line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.fit import FOLDS, Fit, Problem, columns, sensitivities
from sim2real.diagnosis.settings import TINY_SQUARE


class Guess(NamedTuple):
    """A candidate's promise, from how its probes change the simulation."""

    candidate: Candidate
    start: np.ndarray  # (P,) where a fit begins
    gain: float  # share of the squared error that it should remove, judged on the other fold
    error: np.ndarray | None  # (W, T, M) predicted held-out errors
    known: np.ndarray  # (2, K) values of what is known already, as they would then be


class Response(NamedTuple):
    """How one probe of a candidate changes the simulation of the screened windows."""

    candidate: Candidate
    probe: np.ndarray  # (P,)
    change: np.ndarray  # (W, T, M)


class Screening(NamedTuple):
    """What screening found, on its windows."""

    guesses: list[Guess]  # the most promising first
    responses: list[Response]
    base: np.ndarray  # (W, T, M) errors with what is known already
    drift: np.ndarray  # (W, T, M) their change with the clock


def screen(
    problem: Problem,
    found: Fit,
    options: Sequence[Candidate],
    before: Sequence[Response] = (),
) -> Screening:
    """Return a guess for each option, the most promising first.

    A probe's change of the simulation, scaled, should be what is wrong with it, while the values of
    what is known already may follow: a servo that is too soft and rubs is first taken for one that
    rubs too much. Options that change nothing are left out.

    Args:
        problem: on the windows to look at.
        found: the effects that are known already.
        options: what may be added to them.
        before: how options changed a simulation with less or other effects known, on the same
            windows. Beside known effects, of many options only `probed_max` are probed in full:
            those that would promise most if they changed this simulation as they changed that
            one, or, where nothing is known of them, as their middle probes do.
    """
    error, slope = problem.errors(found.members, found.values[None])
    base, drift = error[0], slope[0]
    result = Screening([], [], base, drift)
    known = sensitivities(problem, found.members, found.values, base) if found.members else ()
    free = np.array([drift, *known])
    if found.members and len(options) > problem.data.settings.screening.probed_max:
        options = _likely(problem, found, options, before, result, free)
    _probe(problem, found, options, free, result)
    result.guesses.sort(key=lambda guess: -guess.gain)
    return result


def _likely(
    problem: Problem,
    found: Fit,
    options: Sequence[Candidate],
    before: Sequence[Response],
    now: Screening,
    free: np.ndarray,
) -> list[Candidate]:
    """Return the options that may promise most; adds how the middle probes of others change it."""
    changes: dict[str, list[Response]] = {}
    for response in before:
        changes.setdefault(response.candidate.label, []).append(response)
    gains = {}
    for option in options:
        own = [
            r for r in changes.get(option.label, []) if r.probe.tolist() in option.probes.tolist()
        ]
        if own:
            error = np.array([now.base + response.change for response in own])
            seen = replace(option, probes=np.array([response.probe for response in own]))
            guess = _guess(problem, found, seen, error, now.base, free)
            gains[option.label] = 0.0 if guess is None else guess.gain
    glance = Screening([], [], now.base, now.drift)
    strangers = [_middle(option) for option in options if option.label not in gains]
    _probe(problem, found, strangers, free, glance)
    gains |= {guess.candidate.label: guess.gain for guess in glance.guesses}
    kept = sorted(gains, key=lambda label: -gains[label])[
        : problem.data.settings.screening.probed_max
    ]
    now.responses.extend(r for r in glance.responses if r.candidate.label not in kept)
    return [option for option in options if option.label in kept]


def _middle(option: Candidate) -> Candidate:
    """Return an option with its middle probe in each direction; all where it has free extras."""
    if option.effect.free:
        return option
    change = option.probes - option.neutral
    kept = []
    for sign in np.unique(np.sign(change), axis=0):
        own = np.flatnonzero((np.sign(change) == sign).all(axis=1))
        kept.append(own[np.argsort(np.abs(change[own]).sum(axis=1))[len(own) // 2]])
    return replace(option, probes=option.probes[np.sort(kept)])


def _probe(
    problem: Problem,
    found: Fit,
    options: Sequence[Candidate],
    free: np.ndarray,
    result: Screening,
) -> None:
    """Simulate the options' probes, those of a group in one batch, and add what they promise."""
    for group in dict.fromkeys(option.group for option in options):
        own = [option for option in options if option.group == group]
        _screen_group(problem, found, own, free, result)


def _screen_group(
    problem: Problem,
    found: Fit,
    own: Sequence[Candidate],
    free: np.ndarray,
    result: Screening,
) -> None:
    members = [*found.members, *own]
    known = found.values.shape[1]
    places = columns(own)
    neutral = np.concatenate([option.neutral for option in own])
    points = []
    for option, place in zip(own, places, strict=True):
        for probe in option.probes:
            point = np.concatenate([found.values, np.tile(neutral, (FOLDS, 1))], axis=1)
            point[:, known + place.start : known + place.stop] = probe
            points.append(point)
    error, _ = problem.errors(members, np.array(points))
    start = 0
    for option in own:
        part = slice(start, start + len(option.probes))
        start += len(option.probes)
        guess = _guess(problem, found, option, error[part], result.base, free)
        if guess is not None:
            result.guesses.append(guess)
            changes = error[part] - result.base
            pairs = zip(option.probes, changes, strict=True)
            result.responses.extend(Response(option, probe, change) for probe, change in pairs)


def _guess(
    problem: Problem,
    found: Fit,
    option: Candidate,
    error: np.ndarray,
    base: np.ndarray,
    free: np.ndarray,
) -> Guess | None:
    """Return the best scaled probe of an option; None if it changes nothing.

    Args:
        problem: on the screened windows.
        found: what is known already.
        option: the candidate.
        error: of its probes, (K, W, T, M).
        base: of what is known already, (W, T, M).
        free: the changes that may go with it, of the clock and of each known value, (F, W, T, M).
    """
    limits = problem.data.settings.screening
    before = _squares(problem, _timed(problem, base, free[0]))
    best: Guess | None = None
    own = len(option.neutral) - len(option.effect.free)  # its size, not a phase or the like
    sizes = np.abs(option.probes - option.neutral)[:, :own].sum(axis=1)
    for k, probe in enumerate(option.probes):
        change = error[k] - base
        if (change**2).sum() < limits.change_min * max(before.sum(), TINY_SQUARE):
            continue
        beyond, between = limits.scale_beyond, limits.scale_between
        low = beyond[0] if sizes[k] == sizes.min() else between[0]
        high = beyond[1] if sizes[k] == sizes.max() else between[1]
        scales = _scales(problem, base, np.array([change, *free]), (low, high))  # (2, 1 + F)
        other = scales[::-1][problem.fold]  # (W, 1 + F)
        moved = np.array([change, *free[1:]])
        predicted = base + np.einsum("wf,fwtm->wtm", np.delete(other, 1, axis=1), moved)
        left = _timed(problem, predicted, free[0])
        gain = 1.0 - _squares(problem, left).sum() / max(before.sum(), TINY_SQUARE)
        if best is None or gain > best.gain:
            start = option.towards(probe, float(scales[:, 0].mean()))
            best = Guess(option, start, float(gain), left, found.values + scales[:, 2:])
    return best


def _scales(
    problem: Problem, base: np.ndarray, changes: np.ndarray, bounds: tuple[float, float]
) -> np.ndarray:
    """Return by how much changes are scaled to undo the error of each fold best, (2, 1 + F).

    The first one's scale stays within bounds, the second one's, the clock's, within a step.
    """
    limits = problem.data.settings.screening
    found = np.zeros((FOLDS, len(changes)))
    for f in range(FOLDS):
        own = problem.fold == f
        flat, rest = changes[:, own].reshape(len(changes), -1), base[own].ravel()
        curve, down = flat @ flat.T, -flat @ rest
        curve += np.diag(limits.ridge * np.diag(curve) + limits.ridge_floor)
        held: list[int] = []
        for number, (low, high) in ((1, (-problem.clock, problem.clock)), (0, bounds)):
            found[f] = _solve(curve, down, found[f], held)
            found[f, number] = np.clip(found[f, number], low, high)
            held.append(number)
        found[f] = _solve(curve, down, found[f], held)
    return found


def _solve(
    curve: np.ndarray, down: np.ndarray, scales: np.ndarray, held: Sequence[int]
) -> np.ndarray:
    """Return the scales that minimize a quadratic, some of them held."""
    free = np.setdiff1d(np.arange(len(scales)), held).astype(int)
    result = scales.copy()
    fixed = np.array(held, int)
    against = curve[np.ix_(free, fixed)] @ scales[fixed]
    result[free] = np.linalg.solve(curve[np.ix_(free, free)], down[free] - against)
    return result


def _timed(problem: Problem, error: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return errors with each fold's clock set by the other, (W, T, M)."""
    shift = problem.shift(error, slope)[::-1]
    return error + shift[problem.fold][:, None, None] * slope


def _squares(problem: Problem, error: np.ndarray) -> np.ndarray:
    """Return each window's summed square error, (W,)."""
    return (error**2).sum(axis=(1, 2))
