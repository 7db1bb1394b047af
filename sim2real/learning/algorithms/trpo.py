"""TRPO: the natural gradient within a trust region (Schulman et al. 2015).

    parts = Components(environment, policy, collector=..., advantage=..., loss=..., buffer=...,
                  optimizer=..., seed=0)
    algorithm = TRPO(parts, step=NaturalStep(...), num_rows=16, steps=128, ...)
    while algorithm.frames < 500_000:
        metrics = algorithm.iterate()

One iteration takes `steps` steps in each of `num_rows` rows, estimates advantages, moves the actor
by one natural-gradient step on all samples, and then fits the critic to their returns in
minibatches, for some epochs, by the optimizer. The loss says what the actor climbs and what the
critic is fitted to; any with TorchRL's entries "loss_objective" and "loss_critic" will do.
"""

from typing import Any

import torch
from tensordict import TensorDictBase

from sim2real.learning.algorithms.base import Components
from sim2real.learning.algorithms.checks import check_at_least
from sim2real.learning.algorithms.on_policy import OnPolicy
from sim2real.learning.modules.functional_actor import (
    FunctionalActor,
    Normal,
    divergence,
    fisher_product,
)
from sim2real.learning.optimizers.natural import NaturalStep, ObjectiveAndKL, StepResult
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor


class TRPO(OnPolicy):
    """Trains an actor by natural gradients, and a critic by regression.

    Args:
        parts: all but `adapt`; the optimizer is the critic's.
        step: the actor's step.
        num_rows: N, episodes side by side.
        steps: T, of each row in an iteration.
        critic_epochs: epochs of the critic over the samples of an iteration.
        minibatch_size: samples per gradient step of the critic.
        kl_per_action: whether the divergence is averaged over the actions, as sb3-contrib 2.9 does,
            so that `step.max_kl` holds for each; else it is their sum, as in the paper.

    Raises:
        Sim2RealError: for values out of range, or parts that do not fit together, such as a policy
            whose actor and critic share networks.
    """

    def __init__(
        self,
        parts: Components,
        *,
        step: NaturalStep,
        num_rows: int,
        steps: int,
        critic_epochs: int,
        minibatch_size: int,
        kl_per_action: bool,
    ) -> None:
        check_at_least(1, num_rows=num_rows, steps=steps, critic_epochs=critic_epochs)
        super().__init__(parts, num_rows=num_rows, steps=steps, minibatch_size=minibatch_size)
        self._step, self._critic_epochs = step, critic_epochs
        self._law = FunctionalActor(self.policy.actor)
        critic = list(self._critic.parameters())
        if {id(p) for p in critic} & {id(p) for p in self._law.parameters}:
            raise Sim2RealError(
                "policy: TRPO's critic must not change its actor, but here they share networks; "
                "use "
                "policy=actor_critic, or algorithm=ppo"
            )
        with self._randomness:
            self._optimizer = parts.part("optimizer")(critic)
        actions = self.collecting.env.action_spec.shape[-1]
        self._share = 1 / actions if kl_per_action else 1.0

    def _learn(self, data: TensorDictBase) -> tuple[int, dict[str, float]]:
        """Move the actor, then fit the critic; return the critic's epochs, and what is logged."""
        samples = self._samples(data)
        taken = self._climb(samples)
        self._buffer.empty()
        self._buffer.extend(samples)
        fits = [
            self._fit(minibatch)
            for _ in range(self._critic_epochs)
            for minibatch in self._minibatches()
        ]
        return self._critic_epochs, {
            "train/kl": taken.kl,
            "train/objective_gain": taken.gain,
            "train/backtracks": float(taken.backtracks),
            "train/moved": float(not taken.reason),
            "train/critic_loss": float(torch.stack(fits).mean()),
        }

    def _climb(self, samples: TensorDictBase) -> StepResult:
        """Move the actor along the natural gradient of the loss's objective on samples (B,)."""
        law, seen = self._law, self._law.read(samples)
        start = law.vector()
        gradient = torch.autograd.grad(-self._loss(samples)["loss_objective"], law.parameters)
        with torch.no_grad():
            before = law(start, *seen)
        weight = self._share / len(samples)
        product = fisher_product(lambda vector: law(vector, *seen), start, weight)

        @torch.no_grad()
        def assess(vector: Tensor) -> ObjectiveAndKL:
            law.load(vector)
            objective = -self._loss(samples)["loss_objective"]
            return ObjectiveAndKL(
                float(objective), float(self._divergence(law(vector, *seen), before))
            )

        taken = self._step(start, torch.cat([g.flatten() for g in gradient]), product, assess)
        law.load(taken.theta)
        return taken

    def _divergence(self, new: Normal, old: Normal) -> Tensor:
        return divergence(new, old).mean() * self._share

    def _fit(self, minibatch: TensorDictBase) -> Tensor:
        """Take a gradient step of the critic; return its loss."""
        loss: Any = self._loss(minibatch)["loss_critic"]
        self._optimizer.zero_grad()
        loss.backward()
        self._optimizer.step()
        return loss.detach()
