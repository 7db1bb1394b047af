"""Root mean squares with intervals that know how long errors hang together.

    blocks = Blocks(data, rng, coherence(data, error))
    blocks.rms(error), blocks.interval(error), blocks.closed(before, after, floor)

Samples a few milliseconds apart are no independent evidence: blocks are drawn again, whole. They
are as long as the residue of the model as given hangs together, and about a second at least.
"""

import numpy as np

from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.settings import TINY, TINY_SQUARE

BINS = 4  # of the autocorrelation in the shortest block


class Blocks:
    """Blocks of all windows, and how often each is drawn.

    Args:
        data: the windows.
        rng: the bootstrap's random generator; the same draws serve all errors.
        seconds: length of a block; about a second at least.
    """

    def __init__(self, data: Data, rng: np.random.Generator, seconds: float) -> None:
        numbers = data.blocks(seconds)  # (W, T)
        self.inside = numbers >= 0
        _, self.numbers = np.unique(numbers[self.inside], return_inverse=True)  # (rows,)
        self.count = int(self.numbers.max()) + 1
        self.sizes = np.bincount(self.numbers) * len(data.joints)
        draws, self.level = data.settings.bootstrap.draws, data.settings.inference.level
        self.draws = rng.multinomial(self.count, np.full(self.count, 1 / self.count), draws)

    def squares(self, error: np.ndarray) -> np.ndarray:
        """Return the summed square error of each block, (B,), of errors (W, T, M)."""
        rows = (error**2).sum(axis=2)[self.inside]
        return np.bincount(self.numbers, rows, self.count)

    def rms(self, error: np.ndarray) -> float:
        """Return the root mean square of errors (W, T, M) over all joints and rows."""
        return float(np.sqrt(self.squares(error).sum() / self.sizes.sum()))

    def drawn(self, error: np.ndarray) -> np.ndarray:
        """Return the root mean square in each draw, (D,)."""
        return np.sqrt(self.draws @ self.squares(error) / (self.draws @ self.sizes))

    def interval(self, error: np.ndarray) -> tuple[float, float]:
        """Return the 90 % interval of the root mean square."""
        return self._ends(self.drawn(error))

    def closed(
        self, before: np.ndarray, after: np.ndarray, floor: float
    ) -> tuple[float, tuple[float, float]]:
        """Return the share of the closable gap that is closed, and its 90 % interval."""
        first, last = self.drawn(before), self.drawn(after)
        drawn = (first - last) / np.maximum(first - floor, TINY)
        value = (self.rms(before) - self.rms(after)) / max(self.rms(before) - floor, TINY)
        return min(value, 1.0), self._ends(np.minimum(drawn, 1.0))

    def _ends(self, values: np.ndarray) -> tuple[float, float]:
        """Return the ends of the interval of drawn values (D,)."""
        low, high = np.quantile(values, (self.level, 1 - self.level))
        return float(low), float(high)


def coherence(data: Data, error: np.ndarray) -> float:
    """Return how long squared errors (W, T, M) of all windows hang together [s].

    Their integrated autocorrelation time (Sokal 1997, with the sum up to the first lag that is not
    positive), over bins of an episode; never more than leaves enough blocks to draw from.
    """
    width, total = data.settings.bootstrap.block_s / BINS, 0.0
    found: dict[tuple[int, int, int], list[float]] = {}  # by log, episode and bin
    for window, time, row, mask in zip(data.windows, data.times(), error, data.mask, strict=True):
        total += float(time[-1] - time[0])
        squares = (row[mask] ** 2).sum(axis=1)
        bins = time[mask[: len(time)]] // width
        for place in np.unique(bins):
            key = window.log, window.episode, int(place)
            found.setdefault(key, []).append(float(squares[bins == place].mean()))
    size = {key: float(np.mean(own)) for key, own in found.items()}
    values = np.array([*size.values()])
    middle, spread = values.mean(), max(float(values.var()), TINY_SQUARE)
    longest, length = total / data.settings.windows.windows_min, width
    for lag in range(1, max(int(longest / width), 0) + 1):
        pairs = [
            (v - middle) * (size[log, episode, k + lag] - middle)
            for (log, episode, k), v in size.items()
            if (log, episode, k + lag) in size
        ]
        together = float(np.mean(pairs)) / spread if pairs else 0.0
        if together <= 0:
            break
        length += 2 * together * width
    return min(length, longest)
