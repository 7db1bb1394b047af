"""The natural-gradient step with a trust region, which TRPO and PG-MAML share.

    step = NaturalStep(max_kl=0.01, cg_iterations=10, damping=0.1, backtracks=10, shrink=0.8)
    taken = step(theta, gradient, product, assess)
    taken.theta                                     # (P,); where taken.why says why: theta

After Schulman et al. 2015, "Trust region policy optimization", appendix C: the direction solves
(F + damping) x = gradient by conjugate gradients, its length makes the quadratic model of the
divergence `max_kl`, and a line search shortens it until the objective has risen and the divergence
itself is below the limit.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import torch

from sim2real.runs.errors import Sim2RealError

log = logging.getLogger(__name__)
Tensor = torch.Tensor
Product = Callable[[Tensor], Tensor]
RESIDUAL = 1e-10  # squared norm of a residual at which a solution is exact, as in sb3-contrib 2.9


class ObjectiveAndKL(NamedTuple):
    """The objective of parameters, and their divergence from the policy that acted."""

    objective: float
    kl: float


class StepResult(NamedTuple):
    """The result of a step.

    Attributes:
        theta: the parameters after it, (P,).
        gain: how much the objective rose.
        kl: the divergence from the policy before.
        backtracks: how often the step was shortened.
        why: why the parameters are those of before; "" where they moved.
    """

    theta: Tensor
    gain: float
    kl: float
    backtracks: int
    reason: str


@dataclass(frozen=True, kw_only=True)
class NaturalStep:
    """Climbs an objective as far as a trust region allows.

    Raises:
        Sim2RealError: for values out of range.
    """

    max_kl: float  # largest mean divergence of the new policy from the old one [nat]
    cg_iterations: int  # iterations of the conjugate gradients
    damping: float  # what is added to the Fisher matrix's diagonal
    backtracks: int  # lengths that the line search tries
    shrink: float  # by what a length is multiplied to get the next

    def __post_init__(self) -> None:
        if not self.max_kl > 0 or not self.damping >= 0 or not 0 < self.shrink < 1:
            raise Sim2RealError(
                f"algorithm.step: max_kl={self.max_kl} must be above 0, damping={self.damping} "
                f"at least 0, shrink={self.shrink} between 0 and 1"
            )
        if self.cg_iterations < 1 or self.backtracks < 1:
            raise Sim2RealError(
                f"algorithm.step: cg_iterations={self.cg_iterations} and "
                f"backtracks={self.backtracks} must be at least 1"
            )

    def __call__(
        self,
        theta: Tensor,
        gradient: Tensor,
        product: Product,
        assess: Callable[[Tensor], ObjectiveAndKL],
    ) -> StepResult:
        """Take a step; where none can be taken, say why and keep the parameters.

        Args:
            theta: the parameters, (P,).
            gradient: of the objective at theta, (P,).
            product: multiplies a vector (P,) by the Fisher matrix at theta.
            assess: returns the objective and the divergence at other parameters (P,).
        """
        full, why = self._full_step(gradient, product)
        if full is None:
            return _kept(theta, why)
        start = assess(theta).objective
        length = 1.0
        for count in range(self.backtracks):
            tried = theta + length * full
            found = assess(tried)
            if found.kl < self.max_kl and found.objective > start:  # false for NaN, too
                return StepResult(tried, found.objective - start, found.kl, count, "")
            length *= self.shrink
        return _kept(
            theta,
            f"none of {self.backtracks} lengths raises the objective within a divergence of "
            f"{self.max_kl:g}",
        )

    def _full_step(self, gradient: Tensor, product: Product) -> tuple[Tensor | None, str]:
        """Return the longest step that the quadratic model allows, (P,), or why there is none."""
        if not torch.isfinite(gradient).all():
            return None, "the gradient is not finite"
        if not gradient.any():
            return None, "the gradient is zero"

        def damped(vector: Tensor) -> Tensor:
            return product(vector) + self.damping * vector

        direction = conjugate_gradient(damped, gradient, self.cg_iterations)
        curvature = float(direction @ damped(direction))
        if not torch.isfinite(direction).all() or not 0 < curvature < float("inf"):
            return None, f"the divergence has a curvature of {curvature:g} along the direction"
        if not float(direction @ gradient) > 0:
            return None, "the direction does not climb"
        return (2 * self.max_kl / curvature) ** 0.5 * direction, ""


def _kept(theta: Tensor, why: str) -> StepResult:
    log.warning("natural gradient: %s; the policy is unchanged in this iteration", why)
    return StepResult(theta, 0.0, 0.0, 0, why)


def conjugate_gradient(product: Product, vector: Tensor, iterations: int) -> Tensor:
    """Solve A x = b for a positive definite A (Hestenes and Stiefel 1952).

    Args:
        product: multiplies a vector (P,) by A.
        vector: b, (P,).
        iterations: maximum number of products.

    Returns:
        x, (P,).
    """
    x, residual = torch.zeros_like(vector), vector.clone()
    along, size = residual.clone(), residual @ residual
    for _ in range(iterations):
        if size < RESIDUAL:
            break
        image = product(along)
        rate = size / (along @ image)
        x = x + rate * along
        residual = residual - rate * image
        before, size = size, residual @ residual
        along = residual + size / before * along
    return x
