"""MAML's objective: the return after adaptation, as a function of the parameters before it.

    objective = MetaObjective(law, operator, before, after, start, first_order=False)
    objective.gradient()                            # (P,), through the step of adaptation
    product = objective.fisher(rows)                # the divergence's Hessian, times a vector
    objective.assess(theta)                         # objective and divergence at other parameters

After Finn et al. 2017, "Model-agnostic meta-learning", section 5.3: with theta_T the parameters
that adaptation in task T leads to from theta, the objective is the mean over tasks of

    E_after[ pi(theta_T) / pi(theta_T of the start) * advantage ]

and the divergence the mean of KL(theta_T || theta_T of the start).
"""

from collections.abc import Callable

import torch
from torch.func import grad, vmap

from sim2real.learning.adapt.policy_gradient import PolicyGradient, TransitionBatch
from sim2real.learning.modules.functional_actor import (
    FunctionalActor,
    Normal,
    divergence,
    fisher_product,
    log_prob,
)
from sim2real.learning.optimizers.natural import ObjectiveAndKL, Product

Tensor = torch.Tensor


class MetaObjective:
    """The objective of one iteration.

    Args:
        law: of the actor.
        operator: how it adapts.
        before: steps of B tasks by the start.
        after: steps of the same tasks by what it adapted to.
        start: the parameters, (P,).
        first_order: whether the step of adaptation counts as a constant (Finn et al. 2017, section
            5.2), which leaves its second derivatives out.
    """

    def __init__(
        self,
        law: FunctionalActor,
        operator: PolicyGradient,
        before: TransitionBatch,
        after: TransitionBatch,
        start: Tensor,
        *,
        first_order: bool,
    ) -> None:
        self._law, self._operator = law, operator
        self.before, self.after, self.start = before, after, start
        self._first_order = first_order
        with torch.no_grad():
            self.thetas = self.adapted(start)  # (B, P)
            self._acted = self._laws(self.thetas, after)
            self._began = vmap(law, (None, 0))(start, *before.seen)

    def adapted(self, theta: Tensor, before: TransitionBatch | None = None) -> Tensor:
        """Return each task's adapted parameters, (B, P), from (P,)."""
        experience = self.before if before is None else before
        return vmap(lambda one: self._operator.step(self._law, theta, one))(experience)

    def _laws(self, thetas: Tensor, experience: TransitionBatch) -> Normal:
        return vmap(self._law)(thetas, *experience.seen)

    def _reached(self, theta: Tensor) -> Tensor:
        """Return `adapted` as it is differentiated."""
        return theta + (self.thetas - self.start) if self._first_order else self.adapted(theta)

    def gradient(self) -> Tensor:
        """Return the objective's gradient at the start, (P,)."""
        return grad(lambda theta: self.value(self._reached(theta)))(self.start)

    def value(self, thetas: Tensor) -> Tensor:
        """Return the objective of adapted parameters (B, P)."""
        return self._mean(self._ratio(thetas) * self.after.advantage)

    def clipped(self, theta: Tensor, epsilon: float, kl_weight: float) -> Tensor:
        """Return ProMP's objective (Rothfuss et al. 2019, equation 12) at parameters (P,).

        Args:
            theta: the parameters.
            epsilon: how far a ratio may leave 1 (Schulman et al. 2017).
            kl_weight: weight of the divergence before adaptation, which is subtracted.
        """
        ratio, advantage = self._ratio(self._reached(theta)), self.after.advantage
        near = ratio.clamp(1 - epsilon, 1 + epsilon)
        value = self._mean(torch.minimum(ratio * advantage, near * advantage))
        began = vmap(self._law, (None, 0))(theta, *self.before.seen)
        apart = divergence(began, self._began) * self.before.weight
        return value - kl_weight * apart.sum(-1).mean()

    def _ratio(self, thetas: Tensor) -> Tensor:
        score = log_prob(self._laws(thetas, self.after), self.after.action)  # (B, S)
        return (score - self.after.log_prob).exp()

    def _mean(self, x: Tensor) -> Tensor:
        """Return the mean over tasks of means over their steps (B, S)."""
        return (self.after.weight * x).sum(-1).mean()

    @torch.no_grad()
    def assess(self, theta: Tensor) -> ObjectiveAndKL:
        """Return the objective and the divergence at parameters (P,), adaptation included."""
        thetas = self.adapted(theta)
        apart = divergence(self._laws(thetas, self.after), self._acted)
        return ObjectiveAndKL(float(self.value(thetas)), float(self._mean(apart)))

    def fisher(self, pick: Callable[[TransitionBatch], TransitionBatch]) -> Product:
        """Return a function that multiplies vectors (P,) by the divergence's Hessian at the start.

        Args:
            pick: takes some steps of each task, the same number n of all, each of weight 1 / n: the
                curvature needs fewer than the gradient. Where the step leads to stays exact.
        """
        before, after = pick(self.before), pick(self.after)
        shift = self.thetas - self.start
        if not self._first_order:
            with torch.no_grad():
                shift = self.thetas - self.adapted(self.start, before)

        def laws(theta: Tensor) -> Normal:
            reached = theta if self._first_order else self.adapted(theta, before)
            return self._laws(reached + shift, after)

        return fisher_product(laws, self.start, 1 / after.log_prob.numel())
