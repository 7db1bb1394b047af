"""Scores of transitions as samples of two distributions, (N, F) and (n, N', F).

Columns are divided by their deviation in the real data, so that no unit counts more than another.
"""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

from sim2real.identification.scores.base import Memoryless
from sim2real.runs.distances import TINY, WIDTHS, gaussian, squares, standard
from sim2real.runs.errors import Sim2RealError


def some(values: np.ndarray, most: int, rng: np.random.Generator) -> np.ndarray:
    """Return at most so many rows of values (N, F), drawn at random."""
    if len(values) <= most:
        return values
    return values[rng.choice(len(values), most, replace=False)]


class Mmd(Memoryless):
    """Maximum mean discrepancy with Gaussian kernels (Gretton et al., JMLR 13, 2012), squared.

    Args:
        rows: transitions of each world that are compared, drawn anew each turn.
        widths: of the kernels, in the median distance between real transitions.

    Raises:
        Sim2RealError: too few rows, or no width.
    """

    aligned = False
    rows = None

    def __init__(self, compared: int = 300, widths: tuple[float, ...] = WIDTHS) -> None:
        if compared < 2 or not widths or min(widths) <= 0:
            raise Sim2RealError(
                f"score: compared={compared} must be at least 2 and widths={list(widths)} above 0"
            )
        self.compared, self.widths = compared, tuple(widths)

    def __call__(self, real: np.ndarray, simulated: np.ndarray, turn: int = 0) -> np.ndarray:
        """Return it for each simulation, (n,)."""
        rng = np.random.default_rng(turn)
        first = standard(real, some(real, self.compared, rng))
        within = squares(first, first)
        middle = float(np.median(within[~np.eye(len(first), dtype=bool)])) + TINY
        own = gaussian(within, middle, self.widths).mean()
        found = []
        for one in simulated:
            other = standard(real, some(one, self.compared, rng))
            across = gaussian(squares(first, other), middle, self.widths).mean()
            inside = gaussian(squares(other, other), middle, self.widths).mean()
            found.append(own + inside - 2 * across)
        return np.array(found)


class SlicedWasserstein(Memoryless):
    """Wasserstein distance along random directions (Bonneel et al. 2015), by the library POT.

    Args:
        projections: directions, drawn anew each turn.
        compared: transitions of each world that are compared.

    Raises:
        Sim2RealError: the library is not installed, or too few directions or transitions.
    """

    aligned = False
    rows = None

    def __init__(self, projections: int = 50, compared: int = 1000) -> None:
        if find_spec("ot") is None:
            raise Sim2RealError(
                "score=sliced_wasserstein needs the package POT: pip install 'sim2real[identify]'"
            )
        if projections < 1 or compared < 2:
            raise Sim2RealError(
                f"score: projections={projections} must be at least 1, compared={compared} 2"
            )
        self.projections, self.compared = projections, compared

    def __call__(self, real: np.ndarray, simulated: np.ndarray, turn: int = 0) -> np.ndarray:
        """Return it for each simulation, (n,)."""
        from ot import sliced_wasserstein_distance

        rng = np.random.default_rng(turn)
        first = standard(real, some(real, self.compared, rng))
        found = []
        for one in simulated:
            other = standard(real, some(one, self.compared, rng))
            found.append(
                sliced_wasserstein_distance(first, other, n_projections=self.projections, seed=turn)
            )
        return np.array(found, dtype=float)
