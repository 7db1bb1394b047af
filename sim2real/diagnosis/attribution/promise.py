"""What a candidate's probes promise: how far their changes, scaled, would undo an error.

    for number, guess in promises(view, option, changes): ...       # the best first

A probe's change of the simulation, scaled, should be what is wrong with it, while the values of
what is known already may follow.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.problem import FOLDS, Problem
from sim2real.diagnosis.settings import TINY_SQUARE


class Guess(NamedTuple):
    """A candidate's promise, from how its probes change the simulation."""

    candidate: Candidate
    start: np.ndarray  # (P,) where a fit begins
    gain: float  # share of the squared error that it should remove, judged on the other fold
    known: np.ndarray  # (2, K) values of what is known already, as they would then be


class View(NamedTuple):
    """What is wrong, and what is known already.

    Args:
        problem: on the windows that are looked at.
        found: what is known already.
        base: errors with it, (W, T, M).
        free: the changes that may go with a probe's, of the clock and of each known value,
            (F, W, T, M).
    """

    problem: Problem
    found: Fit
    base: np.ndarray
    free: np.ndarray


def promises(
    view: View, option: Candidate, changes: Mapping[int, np.ndarray]
) -> list[tuple[int, Guess]]:
    """Return what each probe promises, with its number, the best first; none that changes nothing.

    Args:
        view: what is wrong.
        option: the candidate.
        changes: of the simulation by some of its probes, by their numbers, (W, T, M) each.
    """
    problem, found, base, free = view
    limits = problem.data.settings.screening
    before = _squares(problem, _timed(problem, base, free[0]))
    own = len(option.neutral) - len(option.effect.free)  # its size, not a phase or the like
    sizes = np.abs(option.probes - option.neutral)[:, :own].sum(axis=1)
    made = []
    for k, change in changes.items():
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
        start = option.towards(option.probes[k], float(scales[:, 0].mean()))
        made.append((k, Guess(option, start, float(gain), found.values + scales[:, 2:])))
    return sorted(made, key=lambda one: -one[1].gain)


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
    fixed = np.zeros(len(scales), dtype=bool)
    fixed[held] = True
    free, result = ~fixed, scales.copy()
    against = curve[free][:, fixed] @ scales[fixed]
    result[free] = np.linalg.solve(curve[free][:, free], down[free] - against)
    return result


def _timed(problem: Problem, error: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Return errors with each fold's clock set by the other, (W, T, M)."""
    shift = problem.shift(error, slope)[::-1]
    return error + shift[problem.fold][:, None, None] * slope


def _squares(problem: Problem, error: np.ndarray) -> np.ndarray:
    """Return each window's summed square error, (W,)."""
    return (error**2).sum(axis=(1, 2))
