"""What nobody knows about the start of a window, taken out of its errors.

    nuisance = marginal(ways, noise)        # (W, T, M, D): one standard deviation of each unknown
    error = nuisance.clear(windows, error)

Errors e of a window are noise and a start that is off: their covariance is R + S S', with S the
change of the errors by one standard deviation of each unknown. They are multiplied by the symmetric
root of R (R + S S')^-1, in units of the noise: what a start may cause shrinks, what it cannot cause
stays as it is, at its joint and its row. The model as given and every candidate are treated alike,
so that none is paid for a wrong start.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Nuisance:
    """Directions of W windows' errors, and how much of each goes.

    Args:
        ways: orthonormal, in units of the noise, (W, T M, D).
        gone: share of each that is taken out, (W, D).
        noise: of each row of a joint, in the units of errors, (M,).
        weight: of each window's errors, (W,); 1 where nothing speaks against it.
    """

    ways: np.ndarray
    gone: np.ndarray
    noise: np.ndarray
    weight: np.ndarray

    def clear(self, windows: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Return errors (R, T, M) of windows (R,) without what their starts may cause."""
        flat = (error / self.noise).reshape(len(error), -1)
        found = np.empty_like(flat)
        for window in np.unique(windows):
            rows = windows == window
            ways = self.ways[window]
            left = flat[rows] - ((flat[rows] @ ways) * self.gone[window]) @ ways.T
            found[rows] = self.weight[window] * left
        return found.reshape(error.shape) * self.noise

    def directions(self) -> np.ndarray:
        """Return one standard deviation of what each unknown does to errors, (W, T, M, D)."""
        size = np.sqrt(1 / np.square(1 - self.gone) - 1)  # (W, D), see `marginal`
        ways = (self.ways * size[:, None]).reshape(
            len(self.ways), -1, len(self.noise), size.shape[1]
        )
        return ways * self.noise[:, None]

    def only(self, chosen: np.ndarray) -> Nuisance:
        """Return the same of some windows, (n,) indices."""
        parts = (self.ways[chosen], self.gone[chosen], self.noise, self.weight[chosen])
        return Nuisance(*parts)

    def weighed(self, weight: np.ndarray) -> Nuisance:
        """Return the same with other weights of the windows, (W,)."""
        return replace(self, weight=weight)


def marginal(ways: np.ndarray, noise: np.ndarray) -> Nuisance:
    """Return what to take out.

    Args:
        ways: change of the errors by one standard deviation of each unknown, (W, T, M, D); 0 in
            rows that are not compared.
        noise: of each row of a joint, in the units of errors, (M,).
    """
    count = ways.shape[3]
    flat = (ways / noise[:, None]).reshape(len(ways), -1, count)
    left, size, _ = np.linalg.svd(flat, full_matrices=False)
    gone = 1.0 - 1.0 / np.sqrt(1.0 + size**2)
    return Nuisance(left, gone, noise, np.ones(len(left)))
