"""A critic as a pure function of its parameters, for `torch.func`, and what it counts in.

    critic = Critic(policy.critic, unit=12.5)           # it was taught rewards divided by 12.5
    value = FunctionalCritic(critic.module)
    value(value.vector(), observation)                  # (B,)

The counterpart of `Law`: the vector holds the critic's parameters in their order.
"""

from dataclasses import dataclass
from typing import Any

import torch
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch.func import functional_call

from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor


@dataclass(frozen=True)
class Critic:
    """A value function of a policy."""

    module: TensorDictModuleBase  # writes the value of what is observed
    unit: float = 1.0  # what rewards are divided by before they are valued; above 0


class FunctionalCritic:
    """The value that a critic's network writes.

    Args:
        critic: a network of the entry "observation", without a memory and without a body that it
            shares with an actor.

    Raises:
        Sim2RealError: for any other critic, or none.
    """

    def __init__(self, critic: Any) -> None:
        one = isinstance(critic, TensorDictModule) and not isinstance(critic, TensorDictSequential)
        if not one or list(critic.in_keys) != ["observation"]:
            found = "none" if critic is None else type(critic).__name__
            raise Sim2RealError(
                "policy: adapt=ppo and algorithm.critic=true need a critic of the observation "
                f"with separate networks, but found {found}; train with policy=actor_critic, and "
                "algorithm=esmaml with algorithm.critic=true"
            )
        self._module: Any = critic.module
        named = list(self._module.named_parameters())
        self._names = [name for name, _ in named]
        self.parameters = [p for _, p in named]
        self._sizes = [p.numel() for p in self.parameters]

    def vector(self) -> Tensor:
        """Return the present parameters, a copy (P,)."""
        return torch.cat([p.detach().flatten() for p in self.parameters])

    def __call__(self, vector: Tensor, observation: Tensor) -> Tensor:
        """Return the values (...) of observations (..., O) for parameters (P,)."""
        parts = zip(vector.split(self._sizes), self.parameters, strict=True)
        shaped = [part.view(p.shape) for part, p in parts]
        weights = dict(zip(self._names, shaped, strict=True))
        return functional_call(self._module, weights, (observation,))[..., 0]
