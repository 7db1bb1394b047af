"""The first-order meta-gradient: the gradient at each task's adapted parameters.

    cohort = FirstOrder(adapt, queries=300).start_many(thetas, rngs)
    ...                                           # a population runs it
    cohort.gradients.mean(axis=0)                 # ascend the meta-parameters along this

Two stages: an evolution-strategies gradient step at theta, as `GradientAdaptation` makes it, then a
second and independent estimate at the adapted parameters. The Hessian term of the full
meta-gradient is left out.
"""

from __future__ import annotations

import numpy as np

from sim2real.learning.adapt.base import Adaptation, BatchedSession
from sim2real.learning.adapt.gradient import GradientAdaptation, normalize_rows
from sim2real.runs.errors import Sim2RealError


class FirstOrder(Adaptation):
    """Adapts by one gradient step and estimates the gradient where it arrives.

    Args:
        adapt: the adaptation whose step size and perturbations are used.
        queries: perturbed episodes of each of the two estimates.

    Raises:
        Sim2RealError: for an operator that is not a gradient step.
    """

    def __init__(self, adapt: Adaptation, queries: int) -> None:
        if not isinstance(adapt, GradientAdaptation):
            raise Sim2RealError(
                "algorithm.meta_estimator=first_order needs a gradient adaptation, "
                f"got {type(adapt).__name__}; use adapt=gradient or meta_estimator=zeroth_order"
            )
        self.first = GradientAdaptation(
            queries=queries, sigma=adapt.sigma, rate=adapt.rate, baseline=adapt.baseline
        )

    @property
    def queries(self) -> int:
        """Perturbations of both estimates."""
        return 2 * self.first.queries

    @property
    def stages(self) -> tuple[int, ...]:
        """The unchanged policy and its perturbations; then those of the adapted one."""
        return (*self.first.stages, self.first.queries)

    def start_batch(self, thetas: np.ndarray, noise: np.ndarray) -> FirstOrderCohort:
        """Start members with given perturbations; see the base class."""
        return FirstOrderCohort(self, thetas, noise)


class FirstOrderCohort(BatchedSession):
    """Members of `FirstOrder`; `gradients` (n, P) is complete when they are done."""

    def __init__(self, operator: FirstOrder, thetas: np.ndarray, noise: np.ndarray) -> None:
        super().__init__(operator.stages, thetas, noise)
        count = operator.first.queries
        self._first = operator.first.start_batch(thetas, noise[:, :count])
        self._count, self._sigma = count, np.float32(operator.first.sigma)
        self.gradients = np.zeros(self.results.shape)

    def candidates(self, members: np.ndarray, episodes: np.ndarray) -> np.ndarray:
        """Return the parameters to try; see the base class."""
        thetas = self.results[members]
        early = episodes <= self._count
        if early.any():
            thetas[early] = self._first.candidates(members[early], episodes[early])
        if not early.all():
            late = ~early
            thetas[late] += self._sigma * self.noise[members[late], episodes[late] - 1]
        return thetas

    def _advance(self, members: np.ndarray, stage: int) -> None:
        values = self._stage_values(members, stage)
        if stage == 0:
            who = np.repeat(members, values.shape[1])
            self._first.tell(who, np.tile(np.arange(values.shape[1]), len(members)), values.ravel())
            self.results[members] = self._first.results[members]
            return
        weights = normalize_rows(values) / (self._count * float(self._sigma))
        for query in range(self._count):
            noise = self.noise[members, self._count + query]
            self.gradients[members] += weights[:, query, None] * noise
