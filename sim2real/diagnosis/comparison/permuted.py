"""Tests of many columns at once against permutations of before and after.

    tests = Permuted(pieces, rng, draws).of(columns, nuisance, alpha, prior)
    tests.value, tests.spread, tests.p             # of each column, (n,)

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

    def without(self, column: int) -> Prior:
        """Return the prior with nothing known of a column."""
        spread = self.spread.copy()
        spread[column] = np.inf
        return Prior(self.mean, spread)


class Tests(NamedTuple):
    """What was found of n columns."""

    columns: tuple[int, ...]
    critical: float  # |t| beyond which one of all columns lies by chance with probability alpha
    p: np.ndarray  # (n,) adjusted for all columns, with the others free
    value: np.ndarray  # (n,) the change
    spread: np.ndarray  # (n,) its standard error over pieces
    fall: np.ndarray  # (n,) of -2 log likelihood
    response: np.ndarray  # (n,) RMS of what the change makes, in units of the noise
    others: np.ndarray  # (n,) RMS of what the others make with it, clocks left out
    own_share: np.ndarray  # (n,) share of the column's response that the others cannot make


class _Fit(NamedTuple):
    """One column with others, of size 1 each; the column is the first."""

    use: np.ndarray  # (k,) numbers of the columns
    t: np.ndarray  # (1 + D,)
    error: float  # standard error of the column's value
    fitted: np.ndarray  # (k,)
    inverse: np.ndarray  # (k, k) covariance of the values if numbers were independent
    whole: np.ndarray  # (k, k) X'X of all pieces
    size: np.ndarray  # (k,)

    def posterior(self, noise: float, prior: Prior) -> tuple[np.ndarray, np.ndarray]:
        """Return the mean (k,) and the covariance (k, k) of the values; both are normal.

        Args:
            noise: what the variance of independent numbers is multiplied by.
            prior: what is known of the values.
        """
        sure = np.diag((prior.spread[self.use] * self.size) ** -2.0)
        exact = np.linalg.inv(self.inverse * noise)
        after = np.linalg.inv(exact + sure)
        return after @ (exact @ self.fitted + sure @ (prior.mean[self.use] * self.size)), after


class Permuted:
    """Permutations of B pieces, as many draws of them."""

    def __init__(self, pieces: Pieces, rng: np.random.Generator, draws: int) -> None:
        self.pieces, count = pieces, len(pieces.curve)
        if pieces.after is None:  # signs of the differences; the first draw: as they are
            signs = rng.choice([-1.0, 1.0], (draws, count))
            self.weights = [np.concatenate([np.ones((1, count)), signs])]
        else:  # the side after, less the side before
            sides = np.array([pieces.after, *(rng.permutation(pieces.after) for _ in range(draws))])
            self.weights = [sides.astype(float), 1.0 - sides]

    def of(
        self, columns: Sequence[int], nuisance: Sequence[int], alpha: float, prior: Prior
    ) -> Tests:
        """Test n columns, each together with the same others, `nuisance`.

        Args:
            columns: their numbers.
            nuisance: those of the others.
            alpha: probability of any false alarm.
            prior: what is known of the others.
        """
        fits = [self._fit([k, *(other for other in nuisance if other != k)]) for k in columns]
        t = np.array([fit.t for fit in fits])  # (n, 1 + D)
        largest = np.abs(t[:, 1:]).max(axis=0)  # (D,)
        p = (1 + (largest >= np.abs(t[:, :1]) - RIDGE).sum(axis=1)) / (1 + len(largest))
        noise = _inflation(fits)
        rows = np.array([self._row(fit, noise, prior) for fit in fits])
        critical = float(np.quantile(largest, 1 - alpha))
        return Tests(tuple(columns), critical, p, *rows.T)

    def _fit(self, use: Sequence[int]) -> _Fit:
        """Return the fit of the first column with the others."""
        some = np.array(use)
        curve = self.pieces.curve[:, some[:, None], some]
        size = np.sqrt(np.maximum(np.einsum("bkk->k", curve), TINY_SQUARE))
        curve, down = curve / size[:, None] / size, self.pieces.down[:, some] / size
        sides = [_solve(curve, down, weights) for weights in self.weights]
        fitted, errors, inverses = (np.array(part) for part in zip(*sides, strict=True))
        apart = fitted[0] - fitted[1:].sum(axis=0)  # (1 + D, k)
        error, inverse = np.linalg.norm(errors, axis=0), inverses.sum(axis=0)
        t = apart[:, 0] / np.maximum(error, TINY_SQUARE)
        return _Fit(some, t, float(error[0]), apart[0], inverse, curve.sum(axis=0), size)

    def _row(self, fit: _Fit, noise: float, prior: Prior) -> tuple[float, ...]:
        """Return value, spread, fall, response, others and own_share of `Tests`."""
        values, after = fit.posterior(noise, prior.without(fit.use[0]))
        share = float(np.sqrt(after[0, 0] / (fit.inverse[0, 0] * noise)))
        rest = np.where(np.isin(fit.use, self.pieces.clocks), 0.0, values)[1:]
        response = abs(values[0]) * np.sqrt(fit.whole[0, 0] / self.pieces.rows)
        others = np.sqrt(max(float(rest @ fit.whole[1:, 1:] @ rest), 0.0) / self.pieces.rows)
        own = 1.0 if self.pieces.after is None else 0.25
        return (
            values[0] / fit.size[0],
            fit.error * share / fit.size[0],
            values[0] ** 2 / after[0, 0],
            response,
            others,
            noise / after[0, 0] / own,
        )


def explain(pieces: Pieces, columns: Sequence[int], prior: Prior) -> np.ndarray:
    """Return the changes of columns that explain the pieces best, all together, (n,)."""
    observed = Permuted(pieces, np.random.default_rng(), 0)
    fits = [observed._fit(np.roll(columns, -k).tolist()) for k in range(len(columns))]
    return fits[0].posterior(_inflation(fits), prior)[0] / fits[0].size


def _inflation(fits: Sequence[_Fit]) -> float:
    """Return the values' variance over that of independent numbers, in the median of the fits."""
    return float(np.median([max(fit.error**2 / fit.inverse[0, 0], 1.0) for fit in fits]))


def _solve(
    curve: np.ndarray, down: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what k columns fit in draws of pieces, and how sure that is.

    Args:
        curve: X'X of each piece, (B, k, k).
        down: X'y of each, (B, k).
        weights: of X'y in each draw, (D, B): -1, 0 or 1; X'X has their squares.

    Returns:
        The values (D, k), the first one's standard error over pieces (D,), corrected for the
        numbers fitted, and X'X of the first draw inverted.
    """
    square, width = weights**2, curve.shape[1]
    if square.all():  # signs: X'X is the same in all draws
        square, total = square[:1], curve.sum(axis=0, keepdims=True)
    else:
        total = np.einsum("db,bkl->dkl", square, curve)
    size = np.trace(total, axis1=1, axis2=2)[:, None, None] / width
    inverse = np.linalg.inv(total + RIDGE * np.maximum(size, TINY_SQUARE) * np.eye(width))
    fitted = ((weights @ down)[:, None] @ inverse)[:, 0]
    first = inverse[:, 0]
    turned = np.einsum("bkl,dl->dbk", curve, first, optimize=True)
    left = weights * (first @ down.T) - square * np.einsum("dbk,dk->db", turned, fitted)
    count = square.sum(axis=1)
    error = np.sqrt(count / np.maximum(count - width, 1) * (left**2).sum(axis=1))
    return fitted, error, inverse[0]
