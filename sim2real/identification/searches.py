"""Searches: from a prior and numbers that simulations get, to where they are small.

    found = Cma(population=16).minimize(evaluate, prior, seed=0)
    found.best, found.mean, found.std          # (P,) each

`evaluate(points, turn)` is asked once a generation, so that a score may learn between generations.
All randomness follows from the seed.
"""

import math
from collections.abc import Callable
from importlib.util import find_spec
from typing import NamedTuple, Protocol

import numpy as np

from envs.distribution import Distribution
from sim2real.runs.errors import Sim2RealError

Evaluate = Callable[[np.ndarray, int], np.ndarray]  # points (n, P), turn -> (n,)
OnTurn = Callable[[int, int, float], None]  # turns done, turns in all, best number so far


class Box(NamedTuple):
    """A box of parameter values."""

    low: np.ndarray  # (P,)
    high: np.ndarray  # (P,)
    mean: np.ndarray  # (P,), where to start
    names: tuple[str, ...]


Space = Distribution | Box  # where a search looks: in a prior, or in a box


class SearchResult(NamedTuple):
    """The result of a search."""

    best: np.ndarray  # (P,) the point of the smallest number that was seen
    mean: np.ndarray  # (P,) of the last generation's law
    std: np.ndarray  # (P,)
    history: np.ndarray  # (G, 2, P) mean and std after each generation


class Search(Protocol):
    """Base class of searches."""

    def minimize(
        self, evaluate: Evaluate, prior: Space, seed: int, on_turn: OnTurn | None = None
    ) -> SearchResult:
        """Search within the prior's ends.

        Args:
            evaluate: gives each point a number, the smaller the better.
            prior: where to search, and from where.
            seed: of all that is random.
            on_turn: called after each generation.
        """
        ...


class Cma:
    """Covariance matrix adaptation (Hansen 2016, arXiv:1604.00772), by the library `cma`.

    Args:
        population: points a generation; None for the library's choice, 4 + 3 ln P.
        generations: at most.
        sigma: first standard deviation, in widths of the prior.
        tolerance: it ends when the points' spread falls below, in widths of the prior.

    Raises:
        Sim2RealError: the library is not installed, or no generation or population.
    """

    def __init__(
        self,
        population: int | None = None,
        generations: int = 100,
        sigma: float = 0.25,
        tolerance: float = 1e-3,
    ) -> None:
        if find_spec("cma") is None:
            raise Sim2RealError(
                "search=cma needs the package cma: pip install 'sim2real[identify]'"
            )
        if generations < 1 or (population is not None and population < 2) or not sigma > 0:
            raise Sim2RealError(
                f"search: generations={generations} must be at least 1, population={population} at "
                f"least 2 and sigma={sigma:g} above 0"
            )
        self.population, self.generations = population, generations
        self.sigma, self.tolerance = sigma, tolerance

    def minimize(
        self, evaluate: Evaluate, prior: Space, seed: int, on_turn: OnTurn | None = None
    ) -> SearchResult:
        """Search within the prior's ends; see `Search`."""
        import cma

        low, width, count = prior.low, prior.high - prior.low, len(prior.names)
        rng = np.random.default_rng(seed)
        size = max(count, 2)  # CMA-ES needs two dimensions; a second one is not looked at
        middle = np.full(size, 0.5)
        middle[:count] = np.clip((prior.mean - low) / width, 0.0, 1.0)
        options = {
            "bounds": [0.0, 1.0],
            "popsize": self.population or 4 + int(3 * math.log(size)),
            "maxiter": self.generations,
            "tolx": self.tolerance,
            "tolfun": 0.0,
            "tolfunhist": 0.0,
            "tolflatfitness": self.generations,
            "seed": math.nan,  # the library's global generator stays as it is
            "randn": lambda *shape: rng.standard_normal(shape),
            "verbose": -9,
        }
        strategy = cma.CMAEvolutionStrategy(middle, self.sigma, options)
        best, least, history = prior.mean, math.inf, []
        for turn in range(self.generations):
            asked = strategy.ask()
            points = low + width * np.clip(np.array(asked)[:, :count], 0.0, 1.0)
            numbers = evaluate(points, turn)
            strategy.tell(asked, numbers.tolist())
            if numbers.min() < least:
                best, least = points[numbers.argmin()], float(numbers.min())
            history.append((points.mean(axis=0), points.std(axis=0)))
            if on_turn is not None:
                on_turn(turn + 1, self.generations, least)
            if strategy.stop():
                break
        mean, std = history[-1]
        return SearchResult(best, mean, std, np.array(history))


class EasiEs:
    """EASI's evolution strategy: log-rank weighted elites, a diagonal Gaussian, nothing else.

    Dong et al., "EASI" (2024), and its code: generation 1 samples the Gaussian fitted to uniform
    points without ranks; then mean and variance are those of the best half, with CMA-ES's weights.

    Args:
        population: points per generation.
        generations: how many.
        elite: fraction of the points that count.
        floor: least standard deviation in the first generation, in widths of the prior, falling to
            0 in the last; 0 is EASI's own. It keeps a critic from being believed before it knows.

    Raises:
        Sim2RealError: a number out of its range.
    """

    def __init__(
        self, population: int = 300, generations: int = 50, elite: float = 0.5, floor: float = 0.1
    ) -> None:
        if population < 4 or generations < 1 or not 0 < elite <= 1 or floor < 0:
            raise Sim2RealError(
                f"search: population={population} must be at least 4, generations={generations} at "
                f"least 1, elite={elite:g} above 0 and up to 1, floor={floor:g} not negative"
            )
        self.population, self.generations = population, generations
        self.elite, self.floor = elite, floor

    def minimize(
        self, evaluate: Evaluate, prior: Space, seed: int, on_turn: OnTurn | None = None
    ) -> SearchResult:
        """Search within the prior's ends; see `Search`."""
        low, high = prior.low, prior.high
        rng, n = np.random.default_rng(seed), self.population
        points = rng.uniform(low, high, (n, len(low)))
        mean, std = points.mean(axis=0), points.std(axis=0)
        weights = self._weights()
        best, least, history = mean, math.inf, []
        for turn in range(self.generations):
            left = 1 - turn / max(self.generations - 1, 1)
            wide = np.maximum(std, left * self.floor * (high - low))
            points = np.clip(rng.normal(mean, wide, (n, len(low))), low, high)
            numbers = evaluate(points, turn)
            chosen = points[np.argsort(numbers, kind="stable")[: len(weights)]]
            mean = weights @ chosen
            std = np.sqrt(weights @ (chosen - mean) ** 2)
            history.append((mean, std))
            if numbers.min() < least:
                best, least = points[numbers.argmin()], float(numbers.min())
            if on_turn is not None:
                on_turn(turn + 1, self.generations, least)
        return SearchResult(best, mean, std, np.array(history))

    def _weights(self) -> np.ndarray:
        """Return the recombination weights of the elites, (k,), which sum to 1."""
        count = max(1, round(self.elite * self.population))
        raw = np.log((self.population + 1) / 2) - np.log(np.arange(1, count + 1))
        raw = np.maximum(raw, 0.0)
        return raw / raw.sum()
