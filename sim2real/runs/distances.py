"""Distances of two unpaired samples: kernels and slices.

    pool = PooledSamples(samples, group, rng)            # (N, F) in E groups, such as episodes
    pool.wasserstein(first, second)             # weights of the groups, (E,) each
    pool.mmd(first, second)

Samples are sorted and their kernels summed once, so that many sets of groups are compared quickly,
as resampling asks for. A group weighs the same however many samples it has.
"""

import numpy as np

TINY = 1e-9  # a spread below which a column says nothing
HALF = 0.5
WIDTHS = (0.5, 1.0, 2.0)  # of the kernels, in the median distance


def standardize(real: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values (..., F) less the mean of the real data (N, F), over its deviation."""
    return (values - real.mean(axis=0)) / np.maximum(real.std(axis=0), TINY)


def squares(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return square distances, (N, N'), of (N, F) and (N', F)."""
    both = (one**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2 * one @ other.T
    return np.maximum(both, 0.0)


def gaussian(square: np.ndarray, middle: float, widths: tuple[float, ...] = WIDTHS) -> np.ndarray:
    """Return the mean of Gaussian kernels of square distances; widths are in roots of `middle`."""
    return np.mean([np.exp(-HALF * square / (middle * w**2)) for w in widths], axis=0)


class PooledSamples:
    """Samples of all worlds together, standardized, each in a group.

    Args:
        samples: (N, F).
        group: of each sample, (N,) whole numbers from 0.
        rng: draws the directions.
        directions: P along which samples are compared.
    """

    def __init__(
        self, samples: np.ndarray, group: np.ndarray, rng: np.random.Generator, directions: int = 64
    ) -> None:
        ways = rng.standard_normal((samples.shape[1], directions))
        along = samples @ (ways / np.linalg.norm(ways, axis=0))  # (N, P)
        order = np.argsort(along, axis=0)
        self._gaps = np.diff(np.take_along_axis(along, order, axis=0), axis=0)  # (N - 1, P)
        self._group = group[order]
        self._sizes = np.bincount(group)  # (E,)
        self._kernel = _kernel(samples, group, self._sizes)

    def wasserstein(self, first: np.ndarray, second: np.ndarray) -> float:
        """Return the sliced Wasserstein distance, order 1, of two sets of groups.

        It is the area between the distribution functions along a direction, in the mean of the
        directions (Bonneel et al. 2015).

        Args:
            first: weights of the groups, (E,).
            second: those of the other set.
        """
        lead = (_shares(first) - _shares(second)) / np.maximum(self._sizes, 1)
        apart = np.abs(np.cumsum(lead[self._group], axis=0)[:-1])
        return float((apart * self._gaps).sum(axis=0).mean())

    def mmd(self, first: np.ndarray, second: np.ndarray) -> float:
        """Return the maximum mean discrepancy of two sets of groups (Gretton et al. 2012).

        Its root, with Gaussian kernels whose widths are those of the median distance.

        Args:
            first: weights of the groups, (E,).
            second: those of the other set.
        """
        lead = _shares(first) - _shares(second)
        return float(np.sqrt(max(lead @ self._kernel @ lead, 0.0)))


def _shares(weights: np.ndarray) -> np.ndarray:
    return np.asarray(weights, float) / np.sum(weights)


def _kernel(samples: np.ndarray, group: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return the mean kernel between the samples of each two groups, (E, E)."""
    square = squares(samples, samples)
    values = gaussian(square, float(np.median(square[np.triu_indices(len(square), 1)])) + TINY)
    member = (group[:, None] == np.arange(len(sizes))) / np.maximum(sizes, 1)  # (N, E)
    return member.T @ values @ member
