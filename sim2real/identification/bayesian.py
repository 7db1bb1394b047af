"""Bayesian optimization by BoTorch, for simulations so costly that only few are affordable.

    found = Bayesian(first=16, generations=20).minimize(evaluate, prior, seed=0)

A Gaussian process (Matérn kernel, its scales fitted) tells what a number at another point may be;
each generation asks where it is likely to be below the least one that is expected at a point so far
(logarithmic expected improvement: Ament et al., NeurIPS 2023; Balandat et al., "BoTorch", NeurIPS
2020). Numbers that are all above 0, as sums of squares are, are looked at by their logarithm.
"""

from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.stats.qmc import Sobol

from sim2real.identification.searches import Evaluate, OnTurn, SearchResult, Space
from sim2real.runs.errors import Sim2RealError

RESTARTS, RAW = 4, 128  # restarts of the search for the next point, and draws for their starts


class Bayesian:
    """Bayesian optimization with a Gaussian process.

    Args:
        first: points of the first generation, spread evenly (a Sobol sequence).
        population: points of each later one, asked together.
        generations: number of episodes, including the first.

    Raises:
        Sim2RealError: the library is not installed, or numbers below 1.
    """

    def __init__(self, first: int = 16, population: int = 4, generations: int = 25) -> None:
        require("search=bayesian")
        if first < 2 or population < 1 or generations < 1:
            raise Sim2RealError(
                f"search: first={first} must be at least 2, population={population} and "
                f"generations={generations} at least 1"
            )
        self.first, self.population, self.generations = first, population, generations

    def minimize(
        self, evaluate: Evaluate, prior: Space, seed: int, on_turn: OnTurn | None = None
    ) -> SearchResult:
        """Search within the prior's ends; see `Search`."""
        low, width = prior.low, prior.high - prior.low
        asked = spread(len(low), self.first, seed)  # (n, P) in the unit cube
        shares, numbers = np.zeros((0, len(low))), np.zeros(0)
        history = []
        for turn in range(self.generations):
            if turn:
                asked = promising(shares, _values(numbers), self.population, seed + turn)
            scores = evaluate(low + width * asked, turn)
            shares, numbers = np.concatenate([shares, asked]), np.concatenate([numbers, scores])
            best = low + width * shares[numbers.argmin()]
            history.append((best, width * asked.std(axis=0)))
            if on_turn is not None:
                on_turn(turn + 1, self.generations, float(numbers.min()))
        best, std = history[-1]
        return SearchResult(best, best, std, np.array(history))


def require(what: str) -> None:
    """Raise Sim2RealError where the library is not installed; `what` needs it."""
    if find_spec("botorch") is None:
        raise Sim2RealError(f"{what} needs the package botorch: pip install 'sim2real[botorch]'")


def spread(size: int, count: int, seed: int) -> np.ndarray:
    """Return points (count, size) of the unit cube, spread evenly (a Sobol sequence)."""
    return Sobol(size, rng=np.random.default_rng(seed)).random(count)


def promising(points: np.ndarray, values: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Return where the largest values may be (logarithmic expected improvement).

    Args:
        points: that were tried, (n, P) in the unit cube.
        values: what they got, (n,); the larger the better, and noise is allowed for.
        count: how many to ask next.
        seed: of the search for them.

    Returns:
        (count, P).
    """
    import torch
    from botorch.acquisition import qLogExpectedImprovement
    from botorch.optim import optimize_acqf

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model = _model(points, values)
        best = float(_expected(model, points).max())
        wanted = qLogExpectedImprovement(model, best_f=best)
        ends = torch.tensor([[0.0], [1.0]], dtype=torch.double).repeat(1, points.shape[1])
        found, _ = optimize_acqf(wanted, ends, count, RESTARTS, RAW, options={"seed": seed})
    return np.clip(found.numpy(), 0.0, 1.0)


def expected(points: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the posterior mean (n,) at the points (n, P) with values (n,)."""
    return values.mean() + _scale(values) * _expected(_model(points, values), points)


def _model(points: np.ndarray, values: np.ndarray) -> Any:
    """Return a process of standardized values (n,) at points (n, P)."""
    import torch
    from botorch.fit import fit_gpytorch_mll
    from botorch.models import SingleTaskGP
    from gpytorch.mlls import ExactMarginalLogLikelihood

    value = (values - values.mean()) / _scale(values)
    model = SingleTaskGP(torch.tensor(points), torch.tensor(value[:, None]))
    fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))
    return model


def _expected(model: Any, points: np.ndarray) -> np.ndarray:
    """Return a process's mean at points (n, P), (n,)."""
    import torch

    with torch.no_grad():
        return model.posterior(torch.tensor(points)).mean[:, 0].numpy()


def _scale(values: np.ndarray) -> float:
    """Return the standard deviation of values, 1 where they are all the same."""
    return float(values.std()) or 1.0


def _values(numbers: np.ndarray) -> np.ndarray:
    """Return scores to minimize as values to maximize: negated, of positive ones the logarithm."""
    return -np.log(numbers) if numbers.min() > 0 else -numbers
