"""Running mean and standard deviation of observations, frozen while a population runs.

    normalizer = Normalizer(11)
    population.run(..., normalizer=normalizer)      # reads mean and std
    normalizer.update(count, sums, squares)         # afterwards, with what all episodes saw

The sums are of observations minus the frozen mean, which keeps them exact when a mean is far from
0.
"""

from typing import Any

import numpy as np
import torch


class Normalizer:
    """Mean and variance of everything seen so far (Chan et al. 1979, parallel update).

    Args:
        size: O, numbers in an observation.
    """

    def __init__(self, size: int) -> None:
        self.count = 0
        self.mean = np.zeros(size)  # (O,)
        self._squares = np.zeros(size)  # (O,) sum of squared deviations from the mean

    @property
    def std(self) -> np.ndarray:
        """Standard deviation, (O,); 1 where nothing has varied yet."""
        if self.count == 0:
            return np.ones_like(self.mean)
        std = np.sqrt(self._squares / self.count)
        return np.where(std > 0, std, 1.0)

    def update(self, count: int, sums: np.ndarray, squares: np.ndarray) -> None:
        """Add observations that were seen.

        Args:
            count: how many.
            sums: sum of (observation - mean) over them, (O,), with this object's mean.
            squares: sum of (observation - mean)^2, (O,).
        """
        if count == 0:
            return
        total = self.count + count
        shift = sums / count
        between = shift**2 * self.count * count / total
        within = np.maximum(squares - count * shift**2, 0.0)
        self._squares = self._squares + within + between
        self.mean = self.mean + sums / total
        self.count = total

    def state_dict(self) -> dict[str, Any]:
        """Return everything that was seen, as tensors."""
        return {
            "count": self.count,
            "mean": torch.from_numpy(self.mean.copy()),
            "squares": torch.from_numpy(self._squares.copy()),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over a state that `state_dict` returned."""
        self.count = int(state["count"])
        self.mean = state["mean"].numpy().copy()
        self._squares = state["squares"].numpy().copy()
