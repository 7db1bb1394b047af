"""Scores of simulations that belong to the measured rows, (W, T, M) and (n, W, T, M)."""

import numpy as np

from sim2real.diagnosis.settings import TINY_SQUARE
from sim2real.identification.scores.base import Score
from sim2real.runs.errors import Sim2RealError

HALF = 0.5


class KStep(Score):
    """Mean square error of all readings, over their scale.

    Trajectory matching: with whole windows it is what DROID (Tsai et al., RA-L 2021) and PACE
    minimize.

    Args:
        rows: rows on from each measured state; None for whole windows, which need no velocities.

    Raises:
        Sim2RealError: no rows.
    """

    aligned = True

    def __init__(self, rows: int | None = None) -> None:
        if rows is not None and rows < 1:
            raise Sim2RealError(f"score.rows={rows} must be at least 1, or null for whole windows")
        self.rows = rows

    def __call__(self, real: np.ndarray, simulated: np.ndarray, turn: int = 0) -> np.ndarray:
        """Return the mean square error of each simulation, (n,)."""
        return np.nanmean((simulated - real) ** 2, axis=(1, 2, 3))


class OneStep(KStep):
    """Mean square error one row on from each measured state."""

    def __init__(self) -> None:
        super().__init__(rows=1)


class Likelihood(KStep):
    """Negative log-likelihood a reading, noise of each joint profiled out, but for a constant.

    Gaussian errors whose deviation is each reading's own root mean square: joints count by how well
    they can be predicted, whatever their scale.
    """

    def __call__(self, real: np.ndarray, simulated: np.ndarray, turn: int = 0) -> np.ndarray:
        """Return it for each simulation, (n,)."""
        square = np.nanmean((simulated - real) ** 2, axis=(1, 2))  # (n, M)
        return HALF * np.log(np.maximum(square, TINY_SQUARE)).mean(axis=1)
