"""How much each cause closes, how sure its value is, and where the gap lies before and after.

shares = shapley(problem, racing, fit, closed)       # of the closable gap, one a member
spread = intervals(problem, fit, left, rng)          # spread.ends: (P, 2)
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from math import factorial
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from hardware.log import Log
from sim2real.diagnosis.attribution.candidates import FREE
from sim2real.diagnosis.attribution.fit import Fit, Job, columns, refine_each, sensitivities
from sim2real.diagnosis.attribution.problem import FOLDS, Problem
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.replay import Gap
from sim2real.diagnosis.data.score import Blocks
from sim2real.diagnosis.settings import DEFAULT, TINY_SQUARE, Causes

DELAYS = ("command_delay", "observation_delay")
Set = frozenset[int]


def without(fit: Fit, kept: Sequence[int]) -> Fit:
    """Return the fit of some of its members, by their numbers; costs are not known then."""
    places = columns(fit.members)
    members = tuple(fit.members[i] for i in kept)
    picked = [np.arange(places[i].start, places[i].stop) for i in kept]
    values = fit.values[:, np.concatenate([np.zeros(0, int), *picked])]
    return Fit(members, values, np.zeros(FOLDS))


def coalitions(
    problem: Problem, racing: Problem, fit: Fit, full: np.ndarray
) -> dict[Set, np.ndarray]:
    """Return the held-out errors of every subset of a fit's members, each fitted anew.

    Args:
        problem: all windows.
        racing: the windows that subsets are fitted to.
        fit: all members.
        full: its held-out errors, (W, T, M).
    """
    count = len(fit.members)
    sets = [kept for size in range(count) for kept in combinations(range(count), size)]
    rounds = problem.data.settings.causes.subset_rounds
    parts = {kept: without(fit, kept) for kept in sets}
    jobs = [Job(part.members, part.values[None], rounds) for part in parts.values() if part.members]
    parts |= zip((kept for kept in sets if kept), refine_each(racing, jobs), strict=True)
    errors = problem.held_out_each(list(parts.values()))
    found = {frozenset(kept): one for kept, one in zip(sets, errors, strict=True)}
    return {frozenset(range(count)): full, **found}


def one_less(problem: Problem, fit: Fit, full: np.ndarray) -> dict[Set, np.ndarray]:
    """Return the held-out errors of all members, and of all but each; the rest is not fitted anew.

    Args:
        problem: all windows.
        fit: all members.
        full: its held-out errors, (W, T, M).
    """
    every = frozenset(range(len(fit.members)))
    rests = [without(fit, sorted(every - {member})) for member in every]
    errors = zip(every, problem.held_out_each(rests), strict=True)
    return {every: full, **{every - {member}: error for member, error in errors}}


def shapley(values: dict[Set, float], count: int) -> np.ndarray:
    """Return each member's Shapley value, (count,), of what every subset of them closes."""
    shares = np.zeros(count)
    for member in range(count):
        for subset, value in values.items():
            if member not in subset:
                size = len(subset)
                weight = factorial(size) * factorial(count - size - 1) / factorial(count)
                shares[member] += weight * (values[subset | {member}] - value)
    return shares


class Spread(NamedTuple):
    """How far P values may be off."""

    ends: np.ndarray  # (P, 2) 90 % intervals
    correlation: np.ndarray  # (P, P) of the values over blocks that are drawn again


def intervals(
    problem: Problem,
    fit: Fit,
    left: np.ndarray,
    rng: np.random.Generator,
    seconds: float | None = None,
    beside: np.ndarray | None = None,
) -> Spread:
    """Return the 90 % intervals of a fit's values, and how the values go together.

    One Gauss-Newton step on blocks that are drawn again, in each fold; never less than
    the two folds differ, than clocks and counts can resolve, and than what is left of the gap may
    hide. What the model's usual errors add is independent of all that.

    Args:
        problem: all windows.
        fit: the causes.
        left: what is left of the gap over what each of them closes, (n,).
        rng: for the bootstrap.
        seconds: length of its blocks; None: about a second.
        beside: standard deviations that usual errors add, (P,); see `background`. None: none.
    """
    limits, tail = problem.data.settings.causes, problem.data.settings.bootstrap.tail
    error, slope = problem.errors(fit.members, fit.values[None])
    shift = problem.shift(error[0], slope[0])[problem.fold]
    timed = error[0] + shift[:, None, None] * slope[0]
    change = sensitivities(problem, fit.members, fit.values, error[0])  # (P, W, T, M)
    blocks = Blocks(problem.data, problem.windows, rng, seconds)
    numbers = np.full(blocks.inside.shape, -1)
    numbers[blocks.inside] = blocks.numbers
    drawn = []
    for f in range(FOLDS):
        own = (problem.fold == f)[:, None] & blocks.inside  # (W, T)
        flat, residual = change[:, own], timed[own]  # (P, rows, M), (rows, M)
        curve = _summed(np.einsum("prm,qrm->rpq", flat, flat), numbers[own], blocks.count)
        down = _summed(np.einsum("prm,rm->rp", flat, residual), numbers[own], blocks.count)
        matrix = np.tensordot(blocks.draws, curve, 1)  # (D, P, P)
        right = np.tensordot(blocks.draws, down, 1)[..., None]
        drawn.append(fit.values[f] - solved(matrix, right, limits)[..., 0])  # (D, P)
    both = np.mean(drawn, axis=0)
    first, last = np.quantile(both, (tail, 1 - tail), axis=0)
    spread = (last - first) / 2
    apart = np.abs(fit.values[0] - fit.values[1])
    half = np.maximum.reduce([spread, apart, _doubt(fit, left, limits), _resolution(problem, fit)])
    half = np.hypot(half, 0.0 if beside is None else norm.ppf(1 - tail) * beside)
    low = np.concatenate([m.low for m in fit.members])
    high = np.concatenate([m.high for m in fit.members])
    ends = [np.clip(fit.mean - half, low, high), np.clip(fit.mean + half, low, high)]
    return Spread(np.stack(ends, 1), _correlation(both))


def solved(matrix: np.ndarray, right: np.ndarray, limits: Causes) -> np.ndarray:
    """Return what matrices (..., P, P) of squares make `right`, (..., P, K), with a small ridge."""
    size = np.trace(matrix, axis1=-2, axis2=-1)[..., None, None]
    ridge = (limits.ridge * size + limits.ridge_floor) * np.eye(matrix.shape[-1])
    return np.linalg.solve(matrix + ridge, right)


def _correlation(values: np.ndarray) -> np.ndarray:
    """Return the correlation of P values, (P, P), over draws (D, P); none with what stays fixed."""
    apart = values - values.mean(axis=0)
    size = np.maximum(np.sqrt((apart**2).mean(axis=0)), TINY_SQUARE)
    found = (apart / size).T @ (apart / size) / len(values)
    np.fill_diagonal(found, 1.0)
    return found


def _doubt(fit: Fit, left: np.ndarray, limits: Causes = DEFAULT.causes) -> np.ndarray:
    """Return what an error that is left may have done to each parameter, (P,).

    Where something unknown is left, `doubt` of it may act like a part of a cause. Of a factor below
    1 it is a part of the logarithm, so that no interval reaches 0 for it alone.
    """
    neutral = np.concatenate([m.neutral for m in fit.members])
    share = np.repeat(
        np.maximum(limits.doubt * left, limits.doubt_min), [len(m.neutral) for m in fit.members]
    )
    scaled = np.concatenate([[m.effect.how == "scale"] * len(m.neutral) for m in fit.members])
    size = np.abs(np.where(neutral > FREE, fit.mean, fit.mean - neutral))
    factor = np.where(scaled, np.maximum(fit.mean, TINY_SQUARE), 1.0)
    folded = np.minimum(size, factor * np.abs(np.log(factor)))
    return np.where(
        scaled, np.maximum(share * folded, limits.factor_doubt_min * factor), share * size
    )


def _resolution(problem: Problem, fit: Fit) -> np.ndarray:
    """Return what the log can resolve of each parameter, (P,): a clock's error, a count.

    Readings may have stamps of their own, commands never have.
    """
    count = max((joint.count for joint in problem.data.joints), default=0.0)
    found = []
    for member in fit.members:
        finest = max(problem.clock, problem.settings.clock_s) if member.name in DELAYS else 0.0
        finest = count if member.effect.unit == "rad" else finest
        found += [finest] * len(member.neutral)
    return np.array(found)


def _summed(rows: np.ndarray, numbers: np.ndarray, count: int) -> np.ndarray:
    """Return the sums of rows (R, ...) over the blocks that they are in, (count, ...)."""
    out = np.zeros((count, *rows.shape[1:]))
    np.add.at(out, numbers, rows)
    return out


def as_gaps(data: Data, error: np.ndarray) -> list[Gap]:
    """Return each log's compared rows with what was simulated, from held-out errors (W, T, M)."""
    found = []
    for number, log in enumerate(data.logs):
        rows, simulated, said = [], [], []
        for index, window in enumerate(data.windows):
            if window.log == number:
                own = np.flatnonzero(window.usable)
                rows.append(window.first + own)
                said.append(window.measured[own])
                simulated.append(said[-1] + error[index, own] * data.scale)
        kept = np.concatenate(rows)
        part = Log({n: v[kept] for n, v in log.columns.items()}, log.meta, log.path)
        names = tuple(joint.name for joint in data.joints)
        both = np.concatenate(said), np.concatenate(simulated)
        found.append(Gap(part, names, part.time, *both))
    return found


def contradicted(data: Data, blocks: Blocks, rest: np.ndarray, full: np.ndarray) -> bool:
    """Return whether a member helps some held-out regions and surely harms others.

    Args:
        data: the windows.
        blocks: of these windows.
        rest: held-out errors without the member, (W, T, M).
        full: with it.
    """
    gains = []
    for region in regions(data):
        inside = region[:, None, None]
        kept = np.where(inside, rest, 0.0), np.where(inside, full, 0.0)
        size = float((kept[0] ** 2).sum())
        low, high = blocks.gain(*kept)
        scale = blocks.sizes.sum()
        if size > 0:
            gains.append((low * scale / size, high * scale / size))
    limits = data.settings.causes
    helps = any(low > limits.helps for low, _ in gains)
    harms = any(high < -limits.harms for _, high in gains)
    return helps and harms


def regions(data: Data) -> list[np.ndarray]:
    """Return groups of windows, (W,) bool each: calm, lively, without torque, each settings."""
    limits = data.settings.causes
    lively = np.array([w.lively for w in data.windows])
    off = np.array([w.off for w in data.windows]) > limits.off_share
    middle = np.median(lively)
    found = [~off & (lively <= middle), ~off & (lively > middle), off]
    settings = [str(log.settings) for log in data.logs]
    for one in dict.fromkeys(settings):
        if settings.count(one) < len(settings):
            found.append(np.array([settings[w.log] == one for w in data.windows]))
    return [region for region in found if region.sum() >= limits.part_windows_min]
