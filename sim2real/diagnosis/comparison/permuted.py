"""Tests of many columns at once against permutations of before and after.

    tests = Permuted(pieces, rng, draws).of(columns, nuisance)
    tests.value, tests.spread, tests.t, tests.p             # of each column, (n,)

Each column is fitted together with the same few others (`nuisance`); its t uses the spread over
pieces (the sandwich). The null distribution is that of the largest |t| over all columns, with the
signs of the pieces drawn (differences), or their sides exchanged: the chance of any false alarm is
controlled, however much the columns resemble each other (Westfall and Young, 1993).

Whether anything changed is tested with the others free. What changed is estimated with
what is known of the others (`Prior`): a little warmer, all joints may have lost some per cent of
their friction, and not a fifth of it while one gained as much.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.comparison.pieces import Pieces
from sim2real.diagnosis.settings import TINY_SQUARE

RIDGE = 1e-9  # of the diagonal: keeps the equations solvable, far below anything measured


class Prior(NamedTuple):
    """Prior of the change of each of K columns that are not tested."""

    mean: np.ndarray  # (K,)
    spread: np.ndarray  # (K,) standard deviation; inf where nothing is known

    def after(self, moved: Mapping[int, float]) -> Prior:
        """Return the prior of what is left once columns are moved."""
        mean = self.mean.copy()
        mean[list(moved)] -= list(moved.values())
        return Prior(mean, self.spread)


class Tests(NamedTuple):
    """What was found of n columns."""

    columns: tuple[int, ...]
    value: np.ndarray  # (n,) the change
    spread: np.ndarray  # (n,) its standard error over pieces
    t: np.ndarray  # (n,) with the others free
    p: np.ndarray  # (n,) adjusted for all columns
    fall: np.ndarray  # (n,) of -2 log likelihood
    response: np.ndarray  # (n,) RMS of what the change makes, in units of the noise
    others: np.ndarray  # (n,) RMS of what the others make with it, clocks left out
    own_share: np.ndarray  # (n,) share of the column's response that the others cannot make
    critical: float  # |t| beyond which one of all columns lies by chance with probability alpha


class _Fit(NamedTuple):
    """One column with others, of size 1 each; the column is the first."""

    t: np.ndarray  # (1 + D,)
    error: float  # standard error of the column's value
    fitted: np.ndarray  # (k,)
    inverse: np.ndarray  # (k, k) covariance of the values if numbers were independent
    whole: np.ndarray  # (k, k) X'X of all pieces
    size: np.ndarray  # (k,)

    @property
    def inflation(self) -> float:
        """Of the value's variance, over that of independent numbers."""
        return max(self.error**2 / float(self.inverse[0, 0]), 1.0)


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

    def of(
        self,
        columns: Sequence[int],
        nuisance: Sequence[int],
        alpha: float,
        prior: Prior | None = None,
    ) -> Tests:
        """Test columns, each together with the same others.

        Args:
            columns: n numbers.
            nuisance: those of the others.
            alpha: probability of any false alarm.
            prior: what is known of the others; None: nothing.
        """
        every = [[column, *(b for b in nuisance if b != column)] for column in columns]
        fits = [self._one(use) for use in every]
        t = np.array([fit.t for fit in fits])  # (n, 1 + D)
        free = np.array([1 / fit.inverse[0, 0] for fit in fits])
        largest = np.abs(np.where(free[:, None] > 0, t, 0.0)).max(axis=0)[1:]  # (D,)
        p = (1 + (largest >= np.abs(t[:, :1]) - RIDGE).sum(axis=1)) / (1 + len(largest))
        critical = float(np.quantile(largest, 1 - alpha))
        count = self.pieces.curve.shape[1]
        known = prior or Prior(np.zeros(count), np.full(count, np.inf))
        noise = float(np.median([fit.inflation for fit in fits]))
        rows = np.array([self._row(f, u, noise, known) for f, u in zip(fits, every, strict=True)])
        value, spread, fall, response, others, share = rows.T
        return Tests(
            tuple(columns), value, spread, t[:, 0], p, fall, response, others, share, critical
        )

    def _one(self, use: Sequence[int]) -> _Fit:
        """Return the fit of the first column with the others."""
        curve, down, size = _scaled(self.pieces, use)
        solve = _signed if self.pieces.after is None else _sided
        fitted, error, inverse, first = solve(curve, down, self.drawn)
        t = fitted / np.maximum(error, TINY_SQUARE)
        return _Fit(t, float(error[0]), first, inverse, curve.sum(axis=0), size)

    def _row(self, fit: _Fit, use: Sequence[int], noise: float, prior: Prior) -> tuple[float, ...]:
        """Return value, spread, fall, response, others and own_share of `Tests`.

        The fit and the prior are normal, so the posterior is; `noise` is what the independent
        numbers' variance is multiplied by.
        """
        spread, mean = prior.spread[list(use)] * fit.size, prior.mean[list(use)] * fit.size
        sure = np.diag(np.where(np.arange(len(use)) > 0, spread**-2.0, 0.0))
        exact = np.linalg.inv(fit.inverse * noise)
        after = np.linalg.inv(exact + sure)
        values = after @ (exact @ fit.fitted + sure @ mean)
        share = float(np.sqrt(after[0, 0] / (fit.inverse[0, 0] * noise)))
        rest = np.where(np.isin(use, self.pieces.clocks), 0.0, values)[1:]
        response = abs(values[0]) * np.sqrt(fit.whole[0, 0] / self.pieces.rows)
        others = np.sqrt(max(float(rest @ fit.whole[1:, 1:] @ rest), 0.0) / self.pieces.rows)
        own = 1.0 if self.pieces.after is None else 0.25
        size = float(fit.size[0])
        return (
            float(values[0]) / size,
            fit.error * share / size,
            float(values[0] ** 2 / after[0, 0]),
            float(response),
            float(others),
            float(noise / after[0, 0] / own),
        )


def _scaled(pieces: Pieces, columns: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return X'X (B, k, k) and X'y (B, k) of k columns of size 1, and their sizes (k,)."""
    use = np.array(columns)
    curve = pieces.curve[:, use[:, None], use]
    size = np.sqrt(np.maximum(np.einsum("bkk->k", curve), TINY_SQUARE))
    return curve / size[:, None] / size, pieces.down[:, use] / size, size


def _signed(
    curve: np.ndarray, down: np.ndarray, signs: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the first column's value and error in each draw, X'X inverted, and all values."""
    inverse = _inverse(curve.sum(axis=0))
    fitted = (signs @ down) @ inverse  # (D, k)
    own = down @ inverse[0]  # (B,)
    left = signs * own - fitted @ (curve @ inverse[0]).T
    return fitted[:, 0], _error(left, curve.shape[1]), inverse, fitted[0]


def _sided(
    curve: np.ndarray, down: np.ndarray, sides: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the same of the columns' differences between the sides."""
    values, errors, inverses = [], [], []
    for side in (sides, 1 - sides):
        inverse = _inverse(np.einsum("db,bkl->dkl", side, curve))  # (D, k, k)
        fitted = np.einsum("db,bk,dkl->dl", side, down, inverse, optimize=True)
        first = inverse[:, 0]  # (D, k)
        left = side * (first @ down.T - np.einsum("bkl,dl,dk->db", curve, first, fitted))
        values.append(fitted)
        errors.append(_error(left, curve.shape[1], side.sum(axis=1)))
        inverses.append(inverse[0])
    apart = values[0] - values[1]  # (D, k)
    return apart[:, 0], np.hypot(*errors), inverses[0] + inverses[1], apart[0]


def _inverse(matrix: np.ndarray) -> np.ndarray:
    width = matrix.shape[-1]
    size = np.trace(matrix, axis1=-2, axis2=-1)[..., None, None] / width
    return np.linalg.inv(matrix + RIDGE * np.maximum(size, TINY_SQUARE) * np.eye(width))


def _error(left: np.ndarray, width: int, count: np.ndarray | None = None) -> np.ndarray:
    """Return the standard error over pieces (D, B), corrected for the numbers fitted."""
    total = np.full(len(left), left.shape[1]) if count is None else count
    factor = total / np.maximum(total - width, 1)
    return np.sqrt(factor * (left**2).sum(axis=1))
