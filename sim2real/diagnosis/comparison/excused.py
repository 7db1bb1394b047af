"""What is put down to temperature, mounting and supply, simulated rather than drawn as a line.

    left = excuse(pieces, made, (before, after), confounders(made, before, after, remounted))
    left.pieces, left.moved

A tenth less friction in all joints moves a robot by more than a few per cent of it in one, and its
straight line is wrong by as much as what is looked for. So the side after is simulated once more
with what was put down to other things, and only what that leaves is explained by straight lines.
"""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.comparison.confounders import Confounded
from sim2real.diagnosis.comparison.permuted import RIDGE, Prior
from sim2real.diagnosis.comparison.pieces import Pieces, contrasts
from sim2real.diagnosis.comparison.prepared import Prepared
from sim2real.diagnosis.comparison.response import Response, Watch, errors
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.settings import TINY_SQUARE

WORSE = 0.1  # of the squares: clocks take some of what a change mends, and are not in them


class Excused(NamedTuple):
    """What is left, and what was simulated."""

    pieces: Pieces
    moved: dict[int, float]  # of each column


def excuse(
    first: Pieces, made: Prepared, sides: tuple[Collection[int], Collection[int]], found: Confounded
) -> Excused:
    """Return what is left once the side after is simulated with what is put down to other things.

    Args:
        first: the pieces of the errors as they are.
        made: the replayed logs.
        sides: the logs before and those after.
        found: the columns that something else may have changed, and what is known of them.
    """
    columns, response, prior = list(found.aside), made.response, found.prior
    later = np.array([i for i, w in enumerate(made.data.windows) if w.log in sides[1]], int)
    best, moved = first, dict.fromkeys(columns, 0.0)
    if not columns:
        return Excused(best, moved)
    use = [*columns, *best.clocks]
    typical = [float(response.columns[k].option.step[response.columns[k].place]) for k in columns]
    spread = prior.spread[use]
    spread[: len(columns)] = np.minimum(spread[: len(columns)], typical)
    middle, reach = prior.mean[columns], found.reach[columns]
    for _ in range(made.data.settings.compared.excused_rounds):
        left = Prior(prior.after(moved).mean[use], spread)
        more = _fitted(best, use, left)[: len(columns)]
        whole = np.clip(list(moved.values()) + more, middle - reach, middle + reach)
        tried = dict(zip(columns, whole.tolist(), strict=True))
        shifted = made.error.copy()
        shifted[later] = errors(made.simulator, _with(made.watch, response, tried), later)
        pieces = contrasts(made, shifted, *sides)
        if _left(pieces, made.data) > (1 + WORSE) * _left(best, made.data):
            break
        best, moved = pieces, tried
    return Excused(best, moved)


def _fitted(pieces: Pieces, columns: Sequence[int], prior: Prior) -> np.ndarray:
    """Return the changes of columns that explain the pieces best, all together, (n,).

    What the motion does not show follows the prior (n,). The weight of the pieces against it comes
    from the scatter of their slopes at the best fit without it: consecutive rows are correlated.
    """
    use = np.array(columns)
    curve, down = pieces.curve[:, use[:, None], use], pieces.down[:, use]
    exact, slope = curve.sum(axis=0), down.sum(axis=0)
    whole = _firm(exact)
    free = np.linalg.solve(whole, slope)
    if pieces.after is not None:  # what both sides have is free, too
        own = curve[pieces.after].sum(axis=0)
        exact = _firm(own) - own @ np.linalg.solve(whole, own)
        slope = down[pieces.after].sum(axis=0) - own @ free
    known = _scatter(curve, down, free) * np.diag(prior.spread**-2.0)
    return np.linalg.solve(exact + known, slope + known @ prior.mean)


def _firm(matrix: np.ndarray) -> np.ndarray:
    """Return a matrix (n, n) that can be inverted."""
    return matrix + RIDGE * np.diag(np.diag(matrix)) + TINY_SQUARE * np.eye(len(matrix))


def _scatter(curve: np.ndarray, down: np.ndarray, change: np.ndarray) -> float:
    """Return the variance of the pieces' slopes over that of independent numbers, at least 1."""
    slopes = down - curve @ change  # (B, n)
    size = np.einsum("bnn->n", curve)
    return max(float(np.median((slopes**2).sum(axis=0) / np.maximum(size, TINY_SQUARE))), 1.0)


def _with(watch: Watch, response: Response, changes: dict[int, float]) -> Watch:
    """Return the watch with columns changed."""
    for k, change in changes.items():
        for part, share in response.parts.get(k, ((k, 1.0),)):
            watch = watch.moved(response.columns[part], share * change)
    return watch


def _left(pieces: Pieces, data: Data) -> float:
    return float(np.sum((pieces.before_rms / data.scale) ** 2))
