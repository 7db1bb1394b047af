"""Products against the dense matrices that they stand for."""

from functools import reduce

import numpy as np
import pytest

from sim2real.diagnosis.inference.products import (
    Products,
    add,
    condense,
    eliminate,
    integrate,
    predict_each,
)

W, N, L, U = 3, 12, 4, 2
RNG = np.random.default_rng(0)
WAYS = RNG.normal(size=(W, N, L + U))  # whitened directions, each of variance 1
ERRORS = RNG.normal(size=(W, N))


def products(windows: slice = slice(None), rows: slice = slice(None)) -> Products:
    """Return those of some rows of some windows."""
    ways, errors = WAYS[windows, rows], ERRORS[windows, rows]
    cross = (ways.mT @ errors[..., None])[..., 0]
    square = (errors**2).sum(axis=-1) + errors.shape[1] * np.log(2 * np.pi)
    return Products(ways.mT @ ways, cross, square)


def dense(windows: list[int]) -> float:
    """Return the log density of some windows' errors by the definition."""
    count = len(windows)
    own = np.zeros((count, N, count, N))
    for k, w in enumerate(windows):
        own[k, :, k] = np.eye(N) + WAYS[w, :, :L] @ WAYS[w, :, :L].T
    shared = WAYS[windows][..., L:].reshape(count * N, U)
    covariance = own.reshape(2 * (count * N,)) + shared @ shared.T
    errors = ERRORS[windows].ravel()
    square = errors @ np.linalg.solve(covariance, errors)
    return -(square + np.linalg.slogdet(2 * np.pi * covariance)[1]) / 2


def test_rows_add_up() -> None:
    """Two sets of rows give what all rows give."""
    parts = [products(rows=slice(0, 5)), products(rows=slice(5, N))]
    for found, expected in zip(reduce(add, parts), products(), strict=True):
        np.testing.assert_allclose(found, expected)


def test_density_is_the_dense_gaussians() -> None:
    """Each window's own directions are integrated out first, then the common ones."""
    density, mean, precision = condense(integrate(products(), L))
    assert density == pytest.approx(dense([0, 1, 2]), abs=1e-9)
    assert mean.shape == (U,)
    assert (np.linalg.eigvalsh(precision) > 1).all()  # readings say more than the prior alone


def test_a_further_window_has_the_density_of_both_over_that_of_the_known() -> None:
    """p(third | first, second) is a quotient of dense Gaussians."""
    known = integrate(products(slice(0, 2)), L)
    _, mean, precision = condense(known)
    found = predict_each(integrate(products(slice(2, 3)), L), mean, precision)
    assert found == pytest.approx(dense([0, 1, 2]) - dense([0, 1]), abs=1e-9)


@pytest.mark.parametrize("precision", [1.0, 0.25])
def test_elimination_is_the_schur_complement(precision: float) -> None:
    """X' V^-1 X of the other directions, V the noise and the first of their prior."""
    covariance = np.eye(N) + WAYS[0, :, :L] @ WAYS[0, :, :L].T / precision
    expected = WAYS[0, :, L:].T @ np.linalg.solve(covariance, WAYS[0, :, L:])
    found = eliminate(products(slice(0, 1)).gram, L, precision)
    np.testing.assert_allclose(found[0], expected)


def test_no_direction_changes_nothing() -> None:
    """Where nothing is unknown of a window there is nothing to integrate out."""
    every = products()
    assert integrate(every, 0) is every
    assert eliminate(every.gram, 0) is every.gram
