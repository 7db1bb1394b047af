"""Root mean squares with intervals that know how long errors hang together.

    blocks = Blocks(data, windows, rng)
    blocks.rms(error), blocks.interval(error), blocks.gain(before, after)

Samples a few milliseconds apart are no independent evidence: blocks of about a second are drawn
again, whole.
"""

from __future__ import annotations

import numpy as np

from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.settings import TINY


class Blocks:
    """Blocks of about a second of some windows, and how often each is drawn.

    Args:
        data: the windows.
        windows: those that errors are given for, (W,).
        rng: of the bootstrap; the same draws serve all errors.
    """

    def __init__(self, data: Data, windows: np.ndarray, rng: np.random.Generator) -> None:
        numbers = data.blocks()[windows]  # (W, T)
        self.inside = numbers >= 0
        _, compact = np.unique(numbers[self.inside], return_inverse=True)
        self.numbers = compact  # (rows,)
        self.count = int(compact.max()) + 1
        self.sizes = np.bincount(compact, minlength=self.count) * len(data.joints)
        draws, tail = data.settings.bootstrap.draws, data.settings.bootstrap.tail
        self.draws = rng.multinomial(self.count, np.full(self.count, 1 / self.count), draws)
        self._tails = tail, 1 - tail

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

    def gain(self, before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
        """Return the 90 % interval of the fall of the mean square error, paired."""
        fall = self.squares(before) - self.squares(after)
        return self._ends(self.draws @ fall / (self.draws @ self.sizes))

    def closed(
        self, before: np.ndarray, after: np.ndarray, floor: float
    ) -> tuple[float, tuple[float, float]]:
        """Return the share of the closable gap that is closed, and its 90 % interval."""
        first, last = self.drawn(before), self.drawn(after)
        drawn = (first - last) / np.maximum(first - floor, TINY)
        value = (self.rms(before) - self.rms(after)) / max(self.rms(before) - floor, TINY)
        low, high = self._ends(np.minimum(drawn, 1.0))
        return min(value, 1.0), (low, high)

    def _ends(self, values: np.ndarray) -> tuple[float, float]:
        """Return the ends of the interval of drawn values (D,)."""
        low, high = np.quantile(values, self._tails)
        return float(low), float(high)
