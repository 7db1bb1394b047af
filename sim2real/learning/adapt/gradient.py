"""Monte-Carlo gradient adaptation: one step along an evolution-strategies estimate of the gradient.

Song et al. 2020, "ES-MAML: Simple Hessian-free meta learning", with the joint normalization of its
released code.
"""

from typing import Literal

import numpy as np

from sim2real.learning.adapt.base import Adaptation, BatchedSession, check_budget
from sim2real.learning.population.es import orthogonal_directions
from sim2real.runs.errors import Sim2RealError


class GradientAdaptation(Adaptation):
    """theta + rate / (K sigma) * sum_k c_k g_k from K perturbed episodes and one of theta itself.

    The K + 1 returns are brought to zero mean and unit standard deviation together; if all are
    equal nothing changes.

    Args:
        queries: K, perturbed episodes.
        sigma: standard deviation of the perturbations, in parameter units.
        rate: step size alpha.
        baseline: "mean": c_k is the normalized return, so the mean is the baseline; "pivot": c_k is
            its difference from the unperturbed episode's (forward finite differences).
        orthogonal: draw orthogonal perturbations.
        budget: required total number of episodes; None: the number that follows from the rest.

    Raises:
        Sim2RealError: for values out of range, or a budget that does not fit.
    """

    def __init__(
        self,
        *,
        queries: int,
        sigma: float,
        rate: float,
        baseline: Literal["mean", "pivot"],
        orthogonal: bool = False,
        budget: int | None = None,
    ) -> None:
        if queries < 1 or not sigma > 0 or not rate > 0:
            raise Sim2RealError(
                f"adapt: queries={queries} must be at least 1, "
                f"sigma={sigma} and rate={rate} above 0"
            )
        if baseline not in ("mean", "pivot"):
            raise Sim2RealError(f"adapt.baseline={baseline!r} is not one of mean, pivot")
        self._queries, self.sigma, self.rate = queries, sigma, rate
        self.baseline: Literal["mean", "pivot"] = baseline
        self.orthogonal = orthogonal
        check_budget(self, budget, f"set queries={max(1, (budget or 2) - 1)}")

    def __str__(self) -> str:
        """Say what it does and how many episodes it spends."""
        return (
            f"a gradient step, {self.episodes} episodes: 1 unperturbed, {self._queries} perturbed"
        )

    @property
    def queries(self) -> int:
        """K."""
        return self._queries

    @property
    def stages(self) -> tuple[int, ...]:
        """One stage: the unperturbed episode, then K perturbed ones."""
        return (self._queries + 1,)

    def draw(self, rng: np.random.Generator, size: int) -> np.ndarray:
        """Draw the perturbations, (K, size) float32."""
        if self.orthogonal:
            return orthogonal_directions(rng, self._queries, size).astype(np.float32)
        return super().draw(rng, size)

    def start_batch(self, thetas: np.ndarray, noise: np.ndarray) -> BatchedSession:
        """Start members with given perturbations; see the base class."""
        return _GradientCohort(self, thetas, noise)


class _GradientCohort(BatchedSession):
    def __init__(self, operator: GradientAdaptation, thetas: np.ndarray, noise: np.ndarray) -> None:
        super().__init__(operator.stages, thetas, noise)
        self._operator, self._sigma = operator, np.float32(operator.sigma)

    def candidates(self, members: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        step = self._sigma * self.noise[members, episodes - 1]  # (k, P)
        step[episodes == 0] = 0
        return self.results[members] + step

    def _advance(self, members: np.ndarray, stage: int) -> None:
        operator = self._operator
        values = normalize_rows(self._stage_values(members, stage))  # (k, K + 1)
        slopes = values[:, 1:] - (values[:, :1] if operator.baseline == "pivot" else 0)
        slopes *= operator.rate / (operator.queries * operator.sigma)
        slopes = slopes.astype(np.float32)
        for query in range(operator.queries):
            self.results[members] += slopes[:, query, None] * self.noise[members, query]


def mean_rows(values: np.ndarray) -> np.ndarray:
    """Mean of each row of (n, k), column by column, so that rows do not depend on one another."""
    total = values[:, 0].copy()
    for column in values.T[1:]:
        total += column
    return total / values.shape[1]


def normalize_rows(values: np.ndarray) -> np.ndarray:
    """Bring each row of (n, k) to mean 0 and standard deviation 1; a constant row becomes 0."""
    centred = values - mean_rows(values)[:, None]
    spread = np.sqrt(mean_rows(centred**2))
    constant = (values == values[:, :1]).all(axis=1)
    spread[constant] = 1
    centred[constant] = 0
    return centred / spread[:, None]
