"""Scores of transitions as samples of two distributions, (N, F) and (n, N', F).

Columns are divided by their deviation in the real data, so that no unit counts more than another.
"""

from importlib.util import find_spec

import numpy as np

from sim2real.identification.scores.base import Score
from sim2real.runs.distances import TINY, WIDTHS, gaussian, squares, standardize
from sim2real.runs.errors import Sim2RealError


def subsample(values: np.ndarray, most: int, rng: np.random.Generator) -> np.ndarray:
    """Return at most `most` rows of values (N, F), drawn at random."""
    if len(values) <= most:
        return values
    return values[rng.choice(len(values), most, replace=False)]


class Mmd(Score):
    """Maximum mean discrepancy with Gaussian kernels (Gretton et al., JMLR 13, 2012), squared.

    Args:
        rows: transitions of each world that are compared, drawn again each turn.
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
        first = standardize(real, subsample(real, self.compared, rng))
        within = squares(first, first)
        middle = float(np.median(within[~np.eye(len(first), dtype=bool)])) + TINY
        own = gaussian(within, middle, self.widths).mean()
        found = []
        for one in simulated:
            other = standardize(real, subsample(one, self.compared, rng))
            across = gaussian(squares(first, other), middle, self.widths).mean()
            inside = gaussian(squares(other, other), middle, self.widths).mean()
            found.append(own + inside - 2 * across)
        return np.array(found)


class SlicedWasserstein(Score):
    """Wasserstein distance along random directions (Bonneel et al. 2015), by the library POT.

    Args:
        projections: directions, drawn again each turn.
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
        first = standardize(real, subsample(real, self.compared, rng))
        found = []
        for one in simulated:
            other = standardize(real, subsample(one, self.compared, rng))
            found.append(
                sliced_wasserstein_distance(first, other, n_projections=self.projections, seed=turn)
            )
        return np.array(found, dtype=float)


class Embedding(Score):
    """Conditional mean embedding: simulated changes against those predicted from real ones.

    Kernel ridge regression, by random Fourier features (Rahimi and Recht, NeurIPS 2007), learns
    from the real transitions which change follows an observation and an action (Song, Fukumizu and
    Gretton, IEEE Signal Processing Magazine 30, 2013). The score is the mean square by which
    simulated changes differ from that, over the deviations of the real ones. Which observations a
    simulation comes to does not count, as it does in distances of samples, so that few episodes
    are enough; where the real robot never was, nothing is known.

    Args:
        features: how many.
        width: of the kernel, in the median distance between real observations and actions.
        ridge: of the regression, in real transitions.
        compared: real transitions of which the median is taken.

    Raises:
        Sim2RealError: a number out of its range; called before `begin`.
    """

    aligned = False
    rows = None

    def __init__(
        self, features: int = 300, width: float = 1.0, ridge: float = 1e-3, compared: int = 300
    ) -> None:
        if features < 1 or not width > 0 or not ridge > 0 or compared < 2:
            raise Sim2RealError(
                f"score: features={features} must be at least 1, width={width:g} and "
                f"ridge={ridge:g} above 0, compared={compared} at least 2"
            )
        self.features, self.width, self.ridge, self.compared = features, width, ridge, compared
        self._observation: int | None = None

    def begin(self, observation: int, seed: int) -> None:
        """Say how many of a transition's columns are the observation; seed: of the features."""
        self._observation, self._seed = observation, seed

    def __call__(self, real: np.ndarray, simulated: np.ndarray, turn: int = 0) -> np.ndarray:
        """Return it for each simulation, (n,)."""
        if self._observation is None:
            raise Sim2RealError("score=embedding: call begin(observation_size, seed) first")
        rng, changed = np.random.default_rng(self._seed), -self._observation
        before = real[:, :changed]  # observation and action
        few = standardize(before, subsample(before, self.compared, rng))
        apart = squares(few, few)[~np.eye(len(few), dtype=bool)]
        turns = rng.standard_normal((before.shape[1], self.features))
        turns /= self.width * np.sqrt(np.median(apart) + TINY)
        seen = _features(standardize(before, before), turns)  # (N, D)
        wanted = standardize(real[:, changed:], real[:, changed:])  # (N, O)
        square = seen.T @ seen + self.ridge * np.eye(seen.shape[1])
        weights = np.linalg.solve(square, seen.T @ wanted)
        found = []
        for one in simulated:
            expected = _features(standardize(before, one[:, :changed]), turns) @ weights
            off = standardize(real[:, changed:], one[:, changed:]) - expected
            found.append((off**2).mean())
        return np.array(found)


def _features(values: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return a constant, the values (N, F) themselves, and their waves along turns (F, D)."""
    along = values @ turns
    return np.hstack([np.ones((len(values), 1)), values, np.cos(along), np.sin(along)])
