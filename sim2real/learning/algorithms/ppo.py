"""PPO: proximal policy optimization with a clipped objective (Schulman et al. 2017).

    parts = Components(environment, policy, collector=..., advantage=..., loss=..., buffer=...,
                  optimizer=..., seed=0)
    algorithm = PPO(parts, num_rows=16, steps=128, epochs=10, minibatch_size=64, ...)
    while algorithm.frames < 500_000:
        metrics = algorithm.iterate()

One iteration takes `steps` steps in each of `num_rows` rows, estimates advantages, and goes through
the samples in minibatches for some epochs. Each part is TorchRL's, or any with its interface. An
episode that the time limit cuts off goes on in its value; one that the task ends does not.
"""

from typing import Any

import torch
from tensordict import TensorDictBase
from torchrl.modules import set_recurrent_mode

from sim2real.learning.algorithms.base import Components
from sim2real.learning.algorithms.checks import check_at_least, check_positive
from sim2real.learning.algorithms.on_policy import OnPolicy
from sim2real.learning.modules.flat import FlatParameters


class PPO(OnPolicy):
    """Trains an actor and a critic on their own experience.

    Args:
        parts: all but `adapt`.
        num_rows: N, episodes side by side.
        steps: T, of each row in an iteration.
        epochs: epochs over the samples of an iteration.
        minibatch_size: samples per gradient step.
        anneal_frames: environment steps over which the learning rate falls to 0; None keeps it.
        max_grad_norm: maximum norm of the gradient.
        target_kl: divergence from the policy that acted after which an iteration's epochs end; None
            for no limit.

    Raises:
        Sim2RealError: for values out of range, or parts that do not fit together.
    """

    def __init__(
        self,
        parts: Components,
        *,
        num_rows: int,
        steps: int,
        epochs: int,
        minibatch_size: int,
        anneal_frames: int | None,
        max_grad_norm: float,
        target_kl: float | None,
    ) -> None:
        check_at_least(1, num_rows=num_rows, steps=steps, epochs=epochs)
        check_positive(
            anneal_frames=anneal_frames, max_grad_norm=max_grad_norm, target_kl=target_kl
        )
        super().__init__(parts, num_rows=num_rows, steps=steps, minibatch_size=minibatch_size)
        self._epochs = epochs
        self._anneal_frames, self._max_norm, self._target_kl = (
            anneal_frames,
            max_grad_norm,
            target_kl,
        )
        with self._randomness:
            self._optimizer = parts.part("optimizer")(self.policy.parameters())
        self._flat = FlatParameters(list(self.policy.parameters()))
        self._rate = self._optimizer.param_groups[0]["lr"]

    def _learn(self, data: TensorDictBase) -> tuple[int, dict[str, float]]:
        """Go through the samples; return the epochs done, and what the last one logged."""
        self._anneal()
        self._buffer.empty()
        self._buffer.extend(self._samples(data))
        for epoch in range(self._epochs - 1):
            losses = [self._step(minibatch) for minibatch in self._minibatches()]
            if self._target_kl is not None:
                logged = _logged(losses)
                if logged["train/kl"] > self._target_kl:
                    return epoch + 1, logged
        return self._epochs, _logged([self._step(minibatch) for minibatch in self._minibatches()])

    def _step(self, minibatch: TensorDictBase) -> TensorDictBase:
        """Take a gradient step; return the losses."""
        with set_recurrent_mode(self._window > 1):
            losses = self._loss(minibatch)
        self._optimizer.zero_grad()
        terms = [x for name, x in losses.items() if name.startswith("loss_")]
        torch.autograd.backward([x for x in terms if x.requires_grad])
        self._flat.clip_gradient(self._max_norm)
        self._optimizer.step()
        return losses

    def _anneal(self) -> None:
        left = 1.0
        if self._anneal_frames is not None:
            left = max(0.0, 1.0 - self.frames / self._anneal_frames)
        for group in self._optimizer.param_groups:
            group["lr"] = self._rate * left


def _logged(losses: list[TensorDictBase]) -> dict[str, float]:
    """Return the means of what minibatches logged, besides the losses."""
    mean: Any = torch.stack([one.detach() for one in losses]).mean()
    found = {f"train/{k}": float(v) for k, v in mean.items() if not k.startswith("loss_")}
    kept = ("train/clip_fraction", "train/entropy")
    out = {name: value for name, value in found.items() if name in kept}
    if "train/kl_approx" in found and "train/mean_ratio" in found:
        # Schulman's estimator of the divergence: the mean of (r - 1) - log r
        out["train/kl"] = found["train/mean_ratio"] - 1 + found["train/kl_approx"]
    return out
