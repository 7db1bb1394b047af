"""What an unknown start may cause is taken out of errors, and nothing else."""

import numpy as np

from sim2real.diagnosis.ground.starts import clear_starts

NOISE = 0.5


def drawn() -> np.ndarray:
    """Return responses to three unknowns of two windows, (2, 6, 2, 3)."""
    return np.random.default_rng(0).normal(size=(2, 6, 2, 3))


def test_squares_are_those_over_the_whole_covariance() -> None:
    """Noise and unknowns together."""
    ways, error = drawn(), np.random.default_rng(1).normal(size=(2, 6, 2))
    cleared = clear_starts(error, ways, NOISE)
    for way, own, left in zip(ways.reshape(2, 12, 3), error, cleared, strict=True):
        covariance = NOISE**2 * np.eye(12) + way @ way.T
        wanted = own.ravel() @ np.linalg.solve(covariance, own.ravel())
        assert np.isclose(np.sum((left / NOISE) ** 2), wanted)


def test_what_no_start_causes_stays_and_what_a_large_one_causes_goes() -> None:
    """At its joint and row; without unknowns all of it stays."""
    ways = 1e6 * drawn()
    caused = ways @ np.array([1e-6, -2e-6, 0.5e-6])
    assert np.abs(clear_starts(caused, ways, NOISE)).max() < 1e-5
    bases = [np.linalg.qr(way.reshape(12, 3), mode="complete")[0] for way in ways]
    other = np.array([basis[:, 5].reshape(6, 2) for basis in bases])
    assert np.allclose(clear_starts(other, ways, NOISE), other)
    assert np.allclose(clear_starts(other, 0 * ways, NOISE), other)
