"""What an unknown start may cause is taken out of errors, and nothing else."""

import numpy as np

from sim2real.diagnosis.data.nuisance import marginal

NOISE = np.array([0.5, 2.0])


def drawn() -> np.ndarray:
    """Return responses to three unknowns of two windows, (2, 6, 2, 3)."""
    return np.random.default_rng(0).normal(size=(2, 6, 2, 3))


def test_squares_are_those_over_the_whole_covariance() -> None:
    """Noise and unknowns together."""
    ways, error = drawn(), np.random.default_rng(1).normal(size=(4, 6, 2))
    windows = np.array([1, 0, 1, 1])
    cleared = marginal(ways, NOISE).clear(windows, error)
    for row, window in enumerate(windows):
        size = np.tile(NOISE, 6)
        spread = ways[window].reshape(12, 3)
        covariance = np.diag(size**2) + spread @ spread.T
        flat = error[row].ravel()
        wanted = flat @ np.linalg.solve(covariance, flat)
        assert np.isclose((cleared[row].ravel() / size) @ (cleared[row].ravel() / size), wanted)


def test_what_no_start_causes_stays_and_what_a_large_one_causes_goes() -> None:
    """At its joint and row."""
    ways = 1e6 * drawn()
    nuisance = marginal(ways, NOISE)
    caused = ways[0] @ np.array([1e-6, -2e-6, 0.5e-6])
    assert np.abs(nuisance.clear(np.array([0]), caused[None])).max() < 1e-5
    whole, _ = np.linalg.qr((ways[0] / NOISE[:, None]).reshape(12, 3), mode="complete")
    other = (whole[:, 5] * np.tile(NOISE, 6)).reshape(1, 6, 2)
    assert np.allclose(nuisance.clear(np.array([0]), other), other)


def test_without_unknowns_nothing_changes() -> None:
    """And a choice of windows keeps its own."""
    error = np.random.default_rng(1).normal(size=(2, 6, 2))
    assert np.allclose(marginal(0 * drawn(), NOISE).clear(np.array([0, 1]), error), error)
    nuisance = marginal(drawn(), NOISE)
    some = nuisance.only(np.array([1]))
    one = some.clear(np.array([0]), error[:1])
    assert np.allclose(one, nuisance.clear(np.array([1]), error[:1]))
