"""Two effects at once: which pair of screened responses would undo the error together.

    for pair in pairs(problem, base, drift, responses)[:4]: ...

Adding effects one by one fails where two that act against each other have one look-alike: a servo
that is too soft and has friction resembles one whose friction grows with its load.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.attribution.candidates import Candidate, in_the_way
from sim2real.diagnosis.attribution.problem import FOLDS, Problem
from sim2real.diagnosis.attribution.screen import Response
from sim2real.diagnosis.settings import TINY_SQUARE, Screening


class Pair(NamedTuple):
    """Two candidates, where a fit of both starts, and the share of the squared error they undo."""

    members: tuple[Candidate, Candidate]
    start: np.ndarray  # (P,)
    gain: float


def pairs(
    problem: Problem, base: np.ndarray, drift: np.ndarray, responses: Sequence[Response]
) -> list[Pair]:
    """Return the pairs of different candidates, the most promising first.

    Args:
        problem: the problem on the screened windows.
        base: errors to be undone, (W, T, M).
        drift: their change with the clock, (W, T, M).
        responses: how each probe changes the simulation.
    """
    if not responses:
        return []
    limits = problem.data.settings.screening
    gram, across, whole = _products(problem, base, drift, responses)
    names = [(r.candidate.name, r.candidate.effect.where) for r in responses]
    numbers = np.array([names.index(name) for name in names])
    apart = np.array(
        [
            [not in_the_way(a.candidate.effect, b.candidate.effect) for a in responses]
            for b in responses
        ]
    )
    i, j = np.nonzero(np.triu(apart & (numbers[:, None] != numbers[None, :])))
    left = np.zeros(len(i))
    scales = np.zeros((FOLDS, 2, len(i)))
    for f in range(FOLDS):
        scales[f] = _solve(gram[f], across[f], i, j, limits)
        a, b = scales[f]
        g = 1 - f
        left += whole[g] + 2 * (a * across[g, i] + b * across[g, j])
        left += a * a * gram[g, i, i] + b * b * gram[g, j, j] + 2 * a * b * gram[g, i, j]
    gains = 1 - left / max(whole.sum(), TINY_SQUARE)
    found: dict[tuple[int, int], Pair] = {}
    for k in np.argsort(-gains)[: limits.pairs_ranked].tolist():
        one, two = responses[int(i[k])], responses[int(j[k])]
        key = (int(numbers[i[k]]), int(numbers[j[k]]))
        key = (min(key), max(key))
        if key not in found and not _has_twin(found, key, float(gains[k]), limits.pair_twins):
            mean = scales[:, :, k].mean(axis=0)
            both = zip((one, two), mean, strict=True)
            start = np.concatenate([r.candidate.towards(r.probe, float(c)) for r, c in both])
            found[key] = Pair((one.candidate, two.candidate), start, float(gains[k]))
    return list(found.values())


def _has_twin(
    found: Mapping[tuple[int, int], Pair], key: tuple[int, int], gain: float, apart: float
) -> bool:
    """Return whether a pair undoes what another one with one of its members does, to the digit.

    No log may tell a supply from a motor's strength: the second one would take somebody's place.
    """
    return any(
        abs(other.gain - gain) <= apart and bool(set(key) & set(known))
        for known, other in found.items()
    )


def _products(
    problem: Problem, base: np.ndarray, drift: np.ndarray, responses: Sequence[Response]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return inner products in each fold, the clock's part taken out: (2, n, n), (2, n), (2,)."""
    gram: list[np.ndarray] = []
    across: list[np.ndarray] = []
    whole: list[float] = []
    for f in range(FOLDS):
        own = problem.fold == f
        flat = np.stack([r.change[own].ravel() for r in responses]).astype(float)
        error, along = base[own].ravel(), drift[own].ravel()
        unit = along / max(float(np.linalg.norm(along)), TINY_SQUARE)
        flat -= (flat @ unit)[:, None] * unit
        error = error - (error @ unit) * unit
        gram.append(flat @ flat.T)
        across.append(flat @ error)
        whole.append(float(error @ error))
    return np.array(gram), np.array(across), np.array(whole)


def _solve(
    gram: np.ndarray, across: np.ndarray, i: np.ndarray, j: np.ndarray, limits: Screening
) -> np.ndarray:
    """Return the scales (2, pairs) that undo most, within limits."""
    low, high = limits.pair_scale
    floor = limits.pair_ridge_floor
    aa, bb, ab = gram[i, i], gram[j, j], gram[i, j]
    determinant = np.maximum(aa * bb - ab**2, limits.pair_ridge * aa * bb + floor)
    first = np.clip((-across[i] * bb + across[j] * ab) / determinant, low, high)
    second = np.clip(-(across[j] + first * ab) / np.maximum(bb, floor), low, high)
    first = np.clip(-(across[i] + second * ab) / np.maximum(aa, floor), low, high)
    return np.stack([first, second])
