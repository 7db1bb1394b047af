"""Products of directions and errors, all that a Gaussian likelihood of low rank needs of them.

    whole = reduce(add, parts)                          # of joints
    rest = integrate(whole, count)                      # the first directions integrated out
    density, mean, precision = condense(rest)           # of all windows, and the others' posterior

With X the whitened directions, each of variance 1, and e the whitened errors, these are X'X, X'e
and e'e. Integrating directions out is the matrix inversion lemma: a Schur complement.
"""

import operator
from typing import NamedTuple

import numpy as np

HALF = 0.5  # of a square, in the exponent of a Gaussian
VAST = 1e200  # a variance beside which every product is rounded away


class Products(NamedTuple):
    """Products of n windows' D directions, summed over rows and joints."""

    gram: np.ndarray  # (n, D, D) with each other
    cross: np.ndarray  # (n, D) with the whitened errors
    square: np.ndarray  # (n,) see `Projection`


def add(one: Products, other: Products) -> Products:
    """Return the products of two sets of rows together."""
    return Products(*map(operator.add, one, other))


def integrate(of: Products, count: int) -> Products:
    """Return the products of the other directions, the first integrated out of each window."""
    if not count:
        return of
    right = np.concatenate([of.gram[..., :count, count:], of.cross[..., :count, None]], axis=-1)
    root, solved = _solved(of.gram[..., :count, :count] + np.eye(count), right)
    across, along = solved[..., :-1], solved[..., -1]
    left = of.gram[..., count:, count:] - across.mT @ across
    rest = of.cross[..., count:] - np.einsum("...lu,...l->...u", across, along)
    return Products(left, rest, of.square - (along**2).sum(axis=-1) + _log_det(root))


def eliminate(gram: np.ndarray, count: int, precision: float = 1.0) -> np.ndarray:
    """Return products (..., P, P) with the first directions, of some prior, integrated out."""
    if not count:
        return gram
    own = gram[..., :count, :count] + precision * np.eye(count)
    _, across = _solved(own, gram[..., :count, count:])
    return gram[..., count:, count:] - across.mT @ across


def condense(of: Products) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the log density of windows (..., n) together, and the common errors' posterior."""
    precision = of.gram.sum(axis=-3) + np.eye(of.gram.shape[-1])
    pull = of.cross.sum(axis=-2)
    root = np.linalg.cholesky(precision)
    along = np.linalg.solve(root, pull[..., None])[..., 0]
    mean = np.linalg.solve(root.mT, along[..., None])[..., 0]
    density = -HALF * (of.square.sum(axis=-1) - (along**2).sum(axis=-1) + _log_det(root))
    return density, mean, precision


def predict_each(of: Products, mean: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Return the log density of each window under the common errors' posterior, (..., n)."""
    pull = of.cross - of.gram @ mean
    both, prior = np.linalg.cholesky(precision + of.gram), np.linalg.cholesky(precision)
    along = np.linalg.solve(both, pull[..., None])[..., 0]
    grown = _log_det(both) - _log_det(prior)
    return -HALF * (of.square + compute_pull(of, mean) - (along**2).sum(axis=-1) + grown)


def compute_pull(of: Products, mean: np.ndarray) -> np.ndarray:
    """Return what common errors of some mean add to the squares, (..., n)."""
    return np.einsum("u,...uv,v->...", mean, of.gram, mean) - 2 * of.cross @ mean


def _solved(matrix: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the Cholesky roots L of matrices (..., P, P), and L^-1 right, (..., P, K).

    L^-1 right are the further rows of the root of the matrices bordered by these columns.
    """
    count, further = right.shape[-2:]
    whole = np.zeros((*right.shape[:-2], count + further, count + further))
    whole[..., :count, :count], whole[..., count:, :count] = matrix, right.mT
    border = np.arange(count, count + further)
    whole[..., border, border] = VAST
    root = np.linalg.cholesky(whole)
    return root[..., :count, :count], root[..., count:, :count].mT


def _log_det(root: np.ndarray) -> np.ndarray:
    """Return the log determinant of the matrices whose Cholesky roots these are."""
    return 2 * np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
