"""Base class of PPO and TRPO: an actor and a critic that learn from their own steps.

    class Mine(OnPolicy):
        def _learn(self, data): ...                 # from steps (N, T) with their advantages

One iteration takes `steps` steps in each of `num_rows` rows, estimates advantages, and hands all of
it to `_learn`. Each part is TorchRL's, or any with its interface.
"""

from abc import abstractmethod
from collections.abc import Iterator
from typing import Any

import torch
from tensordict import TensorDictBase

from sim2real.learning.algorithms.base import Components
from sim2real.learning.algorithms.checks import check_at_least, check_finite, check_loss
from sim2real.learning.algorithms.collecting import ResumableCollector
from sim2real.learning.algorithms.resumable import CollectingAlgorithm
from sim2real.learning.modules.actor_critic import Policy, check_policy
from sim2real.learning.modules.randomness import TorchRandomStream
from sim2real.runs.errors import Sim2RealError


class OnPolicy(CollectingAlgorithm):
    """Gathers experience, estimates its advantages, and keeps what a resume needs.

    A subclass makes `_optimizer`.

    Args:
        parts: all but `adapt`.
        num_rows: N, episodes side by side.
        steps: T, of each row in an iteration.
        minibatch_size: samples per gradient step.

    Raises:
        Sim2RealError: for values out of range, or parts that do not fit together.
    """

    uses = frozenset({"collector", "advantage", "loss", "buffer", "optimizer"})
    _optimizer: torch.optim.Optimizer

    def __init__(
        self, parts: Components, *, num_rows: int, steps: int, minibatch_size: int
    ) -> None:
        check_at_least(1, num_rows=num_rows, steps=steps, minibatch_size=minibatch_size)
        if num_rows * steps < minibatch_size:
            raise Sim2RealError(
                f"algorithm.minibatch_size={minibatch_size} is more than the {num_rows * steps} "
                "samples of an iteration (num_rows times steps)"
            )
        self.parts = parts
        self._randomness = TorchRandomStream(parts.seed, parts.device)
        with self._randomness:
            env = parts.environment.make(num_rows, device=parts.device, seed=parts.seed)
            self.policy = self._made(parts.policy(env)).to(parts.device)
            for primer in self.policy.primers():
                env.append_transform(primer)
            check_policy(env, self.policy)
            critic = self.policy.critic
            if critic is None:
                raise _refused(f"policy: {self.name} also needs a critic")
            self._critic, self._window = critic, self.policy.window
            if steps % self._window:
                raise Sim2RealError(
                    f"policy.window={self._window} does not divide algorithm.steps={steps}"
                )
            self.collecting = ResumableCollector(parts, env, self.policy.actor, num_rows * steps)
            self._advantage = parts.part("advantage")(value_network=critic)
            self._loss = parts.part("loss")(self.policy.actor, self.policy.loss_critic)
            self._buffer = parts.part("buffer")(batch_size=max(1, minibatch_size // self._window))
        self.frames = self.iteration = 0

    def iterate(self) -> dict[str, float]:
        """Gather experience and learn from it."""
        with self._randomness:
            data = self.collecting.next()  # (N, T)
            with torch.no_grad():
                data = self._advantage(data)
            epochs, learned = self._learn(data)
        check_finite(
            self.policy.parameters(), self.iteration, "optimizer.lr or algorithm.max_grad_norm"
        )
        self.frames += data.numel()
        self.iteration += 1
        return {
            **self.collecting.returns.summary(),
            **learned,
            **_assess(data),
            "train/epochs": float(epochs),
            "train/learning_rate": float(self._optimizer.param_groups[0]["lr"]),
            "train/frames": float(self.frames),
        }

    @abstractmethod
    def _learn(self, data: TensorDictBase) -> tuple[int, dict[str, float]]:
        """Learn from steps (N, T); return the epochs done, and what is logged."""

    def _samples(self, data: TensorDictBase) -> TensorDictBase:
        """Return steps (N, T) one by one, or as windows (S, L) for a policy with a memory."""
        needed = data.select(*self._reads(data), strict=False)
        if self._window == 1:
            return needed.reshape(-1)
        return needed.reshape(-1, self._window)

    def _minibatches(self) -> Iterator[TensorDictBase]:
        """Yield the buffer's minibatches of an epoch, where the networks are."""
        return (minibatch.to(self.parts.device) for minibatch in self._buffer)

    def _reads(self, data: TensorDictBase) -> list[Any]:
        """Return the entries that the loss reads, all of which must be there."""
        keys = [*self._loss.in_keys, *self._advantage.out_keys]
        check_loss(self._loss, data)
        return [*keys, *self.policy.actor.in_keys, *self._critic.in_keys]

    @property
    def name(self) -> str:
        """The name of its configuration, such as "ppo"."""
        return type(self).__name__.lower()

    def _made(self, policy: Any) -> Policy:
        if not isinstance(policy, Policy):
            kind = type(policy).__name__
            raise _refused(
                f"algorithm={self.name} needs an actor and a critic, but {kind} is neither"
            )
        return policy


def _refused(why: str) -> Sim2RealError:
    return Sim2RealError(f"{why}; use policy=actor_critic or policy=gru, or policy=cnn for images")


def _assess(data: TensorDictBase) -> dict[str, float]:
    """Return the critic's mean value and explained variance before the iteration."""
    left = torch.var(data["advantage"]) / torch.var(data["value_target"])
    return {
        "train/value": float(data["state_value"].mean()),
        "train/explained_variance": 1.0 - float(left),
    }
