"""SAC: soft actor-critic with a temperature that is learned (Haarnoja et al. 2018).

    parts = Components(environment, policy, collector=..., loss=..., buffer=..., optimizer=...,
                       seed=0)
    algorithm = SAC(parts, num_rows=8, update_ratio=1.0, batch_size=256, ...)
    while algorithm.frames < 300_000:
        metrics = algorithm.iterate()

After some steps of random actions, each step in all rows goes into the buffer and is followed by as
many gradient steps as are due. Each part is TorchRL's, or any with its interface. An episode that
the time limit cuts off goes on in its value; one that the task ends does not.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.objectives import SoftUpdate

from sim2real.learning.algorithms.base import Components
from sim2real.learning.algorithms.checks import (
    check_at_least,
    check_finite,
    check_fraction,
    check_loss,
    check_positive,
)
from sim2real.learning.algorithms.collecting import ResumableCollector
from sim2real.learning.algorithms.resumable import CollectingAlgorithm
from sim2real.learning.modules.actor_critic import check_policy
from sim2real.learning.modules.randomness import TorchRandomStream
from sim2real.learning.modules.soft_actor_critic import SoftPolicy
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor


class SAC(CollectingAlgorithm):
    """Trains an actor and critics on all that was ever seen.

    Args:
        parts: all but `adapt` and `advantage`.
        num_rows: N, episodes side by side.
        steps: the steps of each row in an iteration; sets only how often metrics are written.
        update_ratio: gradient steps for each environment step.
        batch_size: transitions per gradient step.
        warmup_frames: environment steps of random actions before the first gradient step.
        gamma: discount of a step.
        tau: how much of the critics goes into the target in a gradient step.

    Raises:
        Sim2RealError: for values out of range, or parts that do not fit together.
    """

    uses = frozenset({"collector", "loss", "buffer", "optimizer"})
    counts = ("frames", "iteration", "updates")
    _optimizer: torch.optim.Optimizer

    def __init__(
        self,
        parts: Components,
        *,
        num_rows: int,
        steps: int,
        update_ratio: float,
        batch_size: int,
        warmup_frames: int,
        gamma: float,
        tau: float,
    ) -> None:
        check_at_least(1, num_rows=num_rows, steps=steps, batch_size=batch_size)
        check_at_least(0, warmup_frames=warmup_frames)
        check_fraction(gamma=gamma, tau=tau)
        check_positive(update_ratio=update_ratio)
        self.parts, self._steps = parts, steps
        self._ratio, self._batch, self._warmup = update_ratio, batch_size, warmup_frames
        self._randomness = TorchRandomStream(parts.seed, parts.device)
        with self._randomness:
            env = parts.environment.make(num_rows, device=parts.device, seed=parts.seed)
            self.policy = _made(parts.policy(env)).to(parts.device)
            for primer in self.policy.primers():
                env.append_transform(primer)
            check_policy(env, self.policy)
            random = -(-warmup_frames // num_rows) * num_rows  # whole steps of all rows
            begun = partial(parts.part("collector"), init_random_frames=random)
            self.collecting = ResumableCollector(
                replace(parts, collector=begun), env, self.policy.actor, num_rows
            )
            critics = list(self.policy.qvalues)
            self._loss = parts.part("loss")(
                self.policy.actor, critics, num_qvalue_nets=len(critics)
            )
            self._loss.make_value_estimator(gamma=gamma)
            self._target = SoftUpdate(self._loss, tau=tau)
            self._buffer = parts.part("buffer")()
            self._optimizer = parts.part("optimizer")(self._loss.parameters())
        self.frames = self.iteration = self.updates = 0

    def iterate(self) -> dict[str, float]:
        """Step and learn in turns."""
        with self._randomness:
            for _ in range(self._steps):
                data = self.collecting.next().reshape(-1)  # (N,)
                self._buffer.extend(data.select(*self._reads(data)))
                self.frames += len(data)
                due = self._ratio * (self.frames - self._warmup) - self.updates
                self._learn(int(due + 1e-9))
        check_finite(self._loss.parameters(), self.iteration, "optimizer.lr")
        self.iteration += 1
        return {
            **self.collecting.returns.summary(),
            "train/alpha": float(self._loss.log_alpha.detach().exp()),
            "train/updates": float(self.updates),
            "train/frames": float(self.frames),
        }

    def _reads(self, data: TensorDictBase) -> list[Any]:
        """Return the entries that the loss reads, all of which must be there."""
        if not len(self._buffer):
            check_loss(self._loss, data)
        return list(self._loss.in_keys)

    def _learn(self, count: int) -> None:
        """Take gradient steps."""
        if count < 1:
            return
        drawn = self._buffer.sample(count * self._batch).to(self.parts.device)
        for minibatch in drawn.split(self._batch):
            losses = self._loss(minibatch)
            self._optimizer.zero_grad()
            torch.autograd.backward([x for name, x in losses.items() if name.startswith("loss_")])
            self._optimizer.step()
            self._target.step()
        self.updates += count

    @property
    def shape(self) -> dict[str, Any]:
        """The shape of each parameter."""
        return {name: list(p.shape) for name, p in self._loss.named_parameters()}

    def _networks(self) -> dict[str, Tensor]:
        """Return the parameters, those of the target among them, by name."""
        return dict([*self._loss.named_parameters(), *self._loss.named_buffers()])

    def state_dict(self) -> dict[str, Any]:
        """Return all that the next iterations depend on, the buffer included."""
        return {
            **super().state_dict(),
            "samples": self._buffer[:].clone().to_dict() if len(self._buffer) else {},
            "writer": dict(self._buffer.writer.state_dict()),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restore a state; raises as the base class does."""
        super().load_state_dict(state)
        self._buffer.empty()
        if state["samples"]:
            self._buffer.extend(TensorDict(state["samples"]).auto_batch_size_(1))
        self._buffer.writer.load_state_dict(state["writer"])


def _made(policy: Any) -> SoftPolicy:
    if not isinstance(policy, SoftPolicy):
        raise Sim2RealError(
            f"algorithm=sac needs an actor and critics, but {type(policy).__name__} is neither; "
            f"use policy=soft_actor_critic"
        )
    return policy
