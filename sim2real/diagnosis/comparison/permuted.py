"""Tests of many columns at once against permutations of before and after.

    tests = Permuted(pieces, rng, draws).of(columns, beside)
    tests.value, tests.spread, tests.t, tests.p             # of each column, (n,)

Each column is fitted beside the same few others; its t uses the spread over pieces (the sandwich).
The null distribution is that of the largest |t| over all columns, with the signs of the pieces
drawn (differences), or their sides exchanged: the chance of any false alarm is controlled, however
much the columns resemble each other (Westfall and Young, 1993).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.comparison.pieces import Pieces
from sim2real.diagnosis.settings import TINY_SQUARE

RIDGE = 1e-9  # of the diagonal: keeps the equations solvable, far below anything measured


class Tests(NamedTuple):
    """What was found of n columns."""

    columns: tuple[int, ...]
    value: np.ndarray  # (n,) the change
    spread: np.ndarray  # (n,) its standard error over pieces
    t: np.ndarray  # (n,)
    p: np.ndarray  # (n,) adjusted for all columns
    fall: np.ndarray  # (n,) of the weighted square of what is off
    inflation: np.ndarray  # (n,) of the value's variance, over that of independent numbers
    response: np.ndarray  # (n,) RMS of what the change makes, in units of the noise
    others: np.ndarray  # (n,) RMS of what the others make beside it
    told: np.ndarray  # (n,) share of the column's response that the others cannot make
    critical: float  # |t| beyond which one of all columns lies by chance with probability alpha


class Permuted:
    """Permutations of pieces.

    Args:
        pieces: B of them.
        rng: for the draws.
        draws: of them.
    """

    def __init__(self, pieces: Pieces, rng: np.random.Generator, draws: int) -> None:
        self.pieces, count = pieces, len(pieces.curve)
        if pieces.after is None:
            signs = rng.choice([-1.0, 1.0], (draws, count))
            self.drawn = np.concatenate([np.ones((1, count)), signs])  # the first: as it is
        else:
            sides = np.array([rng.permutation(pieces.after) for _ in range(draws)])
            self.drawn = np.concatenate([pieces.after[None], sides]).astype(float)

    def of(self, columns: Sequence[int], beside: Sequence[int], alpha: float) -> Tests:
        """Test columns, each beside the same others.

        Args:
            columns: n numbers.
            beside: those of the others.
            alpha: probability of any false alarm.
        """
        fits = [self._one(column, [b for b in beside if b != column]) for column in columns]
        t = np.array([fit[0] for fit in fits])  # (n, 1 + D)
        response, others, told = (np.array([fit[k] for fit in fits]) for k in (5, 6, 7))
        largest = np.abs(np.where(told[:, None] > 0, t, 0.0)).max(axis=0)[1:]  # (D,)
        p = (1 + (largest >= np.abs(t[:, :1]) - RIDGE).sum(axis=1)) / (1 + len(largest))
        value, spread, fall, inflation = (np.array([fit[k] for fit in fits]) for k in range(1, 5))
        critical = float(np.quantile(largest, 1 - alpha))
        own = (value, spread, t[:, 0], p, fall, inflation, response, others, told)
        return Tests(tuple(columns), *own, critical)

    def _one(self, column: int, beside: list[int]) -> tuple[np.ndarray, *tuple[float, ...]]:
        """Return t (1 + D,), and the numbers of `Tests` of one column, in their order."""
        curve, down, size = _scaled(self.pieces, [column, *beside])
        solve = _signed if self.pieces.after is None else _sided
        value, error, free, fitted = solve(curve, down, self.drawn)
        t = value / np.maximum(error, TINY_SQUARE)
        naive = 1 / free  # variance of the value if numbers were independent, of unit noise
        inflation = max(float(error[0] ** 2) / naive, 1.0)
        fall = float(value[0] ** 2) / naive
        told = free / (1.0 if self.pieces.after is None else 0.25)
        scaled = float(value[0] / size[0]), float(error[0] / size[0])
        whole = curve.sum(axis=0)
        response = abs(fitted[0]) * np.sqrt(whole[0, 0] / self.pieces.rows)
        rest = fitted[1:] @ whole[1:, 1:] @ fitted[1:]
        others = np.sqrt(max(float(rest), 0.0) / self.pieces.rows)
        return t, *scaled, fall, inflation, float(response), float(others), float(told)


def _scaled(pieces: Pieces, columns: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return X'X (B, k, k) and X'y (B, k) of k columns of size 1, and their sizes (k,)."""
    use = np.array(columns)
    curve = pieces.curve[:, use[:, None], use]
    size = np.sqrt(np.maximum(np.einsum("bkk->k", curve), TINY_SQUARE))
    return curve / size[:, None] / size, pieces.down[:, use] / size, size


def _signed(
    curve: np.ndarray, down: np.ndarray, signs: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Return the first column's value and error in each draw, its free share, and all values."""
    inverse = _inverse(curve.sum(axis=0))
    fitted = (signs @ down) @ inverse  # (D, k)
    own = down @ inverse[0]  # (B,)
    left = signs * own - fitted @ (curve @ inverse[0]).T
    return fitted[:, 0], _error(left, curve.shape[1]), 1 / inverse[0, 0], fitted[0]


def _sided(
    curve: np.ndarray, down: np.ndarray, sides: np.ndarray
) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Return the same of the columns' differences between the sides."""
    values, errors, free = [], [], []
    for side in (sides, 1 - sides):
        inverse = _inverse(np.einsum("db,bkl->dkl", side, curve))  # (D, k, k)
        fitted = np.einsum("db,bk,dkl->dl", side, down, inverse, optimize=True)
        first = inverse[:, 0]  # (D, k)
        left = side * (first @ down.T - np.einsum("bkl,dl,dk->db", curve, first, fitted))
        values.append(fitted)
        errors.append(_error(left, curve.shape[1], side.sum(axis=1)))
        free.append(1 / inverse[0, 0, 0])
    total = free[0] * free[1] / (free[0] + free[1])
    apart = values[0] - values[1]  # (D, k)
    return apart[:, 0], np.hypot(*errors), total, apart[0]


def _inverse(matrix: np.ndarray) -> np.ndarray:
    width = matrix.shape[-1]
    size = np.trace(matrix, axis1=-2, axis2=-1)[..., None, None] / width
    return np.linalg.inv(matrix + RIDGE * np.maximum(size, TINY_SQUARE) * np.eye(width))


def _error(left: np.ndarray, width: int, count: np.ndarray | None = None) -> np.ndarray:
    """Return the standard error over pieces (D, B), corrected for the numbers fitted."""
    total = np.full(len(left), left.shape[1]) if count is None else count
    factor = total / np.maximum(total - width, 1)
    return np.sqrt(factor * (left**2).sum(axis=1))
