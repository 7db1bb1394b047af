"""Bayesian optimization by BoTorch: for simulations that are so dear that only few can be paid.

    found = Bayesian(first=16, generations=20).minimize(evaluate, prior, seed=0)

A Gaussian process (Matérn kernel, its scales fitted) tells what a number at another point may be;
each generation asks where it is likely to be below the least one so far (logarithmic expected
improvement: Ament et al., NeurIPS 2023; Balandat et al., "BoTorch", NeurIPS 2020). Numbers that are
all above 0, as sums of squares are, are looked at by their logarithm.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.stats.qmc import Sobol

from sim2real.identification.searches import Evaluate, Found, OnTurn, Space
from sim2real.runs.errors import Sim2RealError

RESTARTS, RAW = 4, 128  # of the search for where to ask next: from so many of so many drawn points


class Bayesian:
    """See the module's text.

    Args:
        first: points of the first generation, spread evenly (a Sobol sequence).
        population: points of each later one, asked together.
        generations: how many, the first among them.

    Raises:
        Sim2RealError: the library is not installed, or numbers below 1.
    """

    def __init__(self, first: int = 16, population: int = 4, generations: int = 25) -> None:
        if find_spec("botorch") is None:
            raise Sim2RealError(
                "search=bayesian needs the package botorch: pip install 'sim2real[botorch]'"
            )
        if first < 2 or population < 1 or generations < 1:
            raise Sim2RealError(
                f"search: first={first} must be at least 2, population={population} and "
                f"generations={generations} at least 1"
            )
        self.first, self.population, self.generations = first, population, generations

    def minimize(
        self,
        evaluate: Evaluate,
        prior: Space,
        seed: int,
        on_turn: OnTurn | None = None,
    ) -> Found:
        """Search within the prior's ends; see `Search`."""
        low, width = prior.low, prior.high - prior.low
        sobol = Sobol(len(low), rng=np.random.default_rng(seed))
        asked = sobol.random(self.first)  # (n, P) in the unit cube
        shares, numbers = np.zeros((0, len(low))), np.zeros(0)
        history = []
        for turn in range(self.generations):
            if turn:
                asked = _next(shares, numbers, self.population, seed + turn)
            told = evaluate(low + width * asked, turn)
            shares, numbers = np.concatenate([shares, asked]), np.concatenate([numbers, told])
            best = low + width * shares[numbers.argmin()]
            history.append((best, width * asked.std(axis=0)))
            if on_turn is not None:
                on_turn(turn + 1, self.generations, float(numbers.min()))
        best, std = history[-1]
        return Found(best, best, std, np.array(history))


def _next(shares: np.ndarray, numbers: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Return the points (count, P) that promise most, given numbers (n,) at points (n, P)."""
    import torch
    from botorch.acquisition import qLogExpectedImprovement
    from botorch.optim import optimize_acqf

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        model, best = _model(shares, numbers)
        wanted = qLogExpectedImprovement(model, best_f=best)
        ends = torch.tensor([[0.0], [1.0]], dtype=torch.double).repeat(1, shares.shape[1])
        points, _ = optimize_acqf(wanted, ends, count, RESTARTS, RAW, options={"seed": seed})
    return np.clip(points.numpy(), 0.0, 1.0)


def _model(shares: np.ndarray, numbers: np.ndarray) -> tuple[Any, float]:
    """Return a process of what is to be maximized, and the largest of it so far."""
    import torch
    from botorch.fit import fit_gpytorch_mll
    from botorch.models import SingleTaskGP
    from gpytorch.mlls import ExactMarginalLogLikelihood

    value = -np.log(numbers) if numbers.min() > 0 else -numbers
    spread = value.std()
    value = (value - value.mean()) / (spread if spread > 0 else 1.0)
    model = SingleTaskGP(torch.tensor(shares), torch.tensor(value[:, None]))
    fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))
    return model, float(value.max())
