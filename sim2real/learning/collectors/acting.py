"""Calling an actor at each step of many rows, without what TorchRL does around its networks.

    act = acting(actor)
    act(tensordict)                                   # writes loc, scale, action, action_log_prob

For small networks `TensorDictModule`, the distribution and its checks cost several times what the
layers do. The numbers are the same to the last bit, those drawn included.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import (
    ProbabilisticTensorDictModule,
    ProbabilisticTensorDictSequential,
    TensorDictModule,
)
from torchrl.envs.utils import ExplorationType, exploration_type
from torchrl.modules import IndependentNormal

Tensor = torch.Tensor
HALF_LOG_2PI = math.log(math.sqrt(2 * math.pi))


def acting(policy: Callable[[TensorDictBase], TensorDictBase]) -> Callable[[TensorDictBase], Any]:
    """Return a function that writes a policy's entries into a tensordict."""
    if _is_gaussian(policy):
        return Gaussian(policy)  # type: ignore[arg-type]

    def act(tensordict: TensorDictBase) -> None:
        out = policy(tensordict)
        if out is not tensordict:
            tensordict.update(out)

    return act


def _is_gaussian(policy: Any) -> bool:
    """Say whether a policy is networks and, last, a Gaussian around what they say."""
    if not isinstance(policy, ProbabilisticTensorDictSequential) or policy._forward_hooks:
        return False
    *networks, last = policy.module
    return (
        all(type(network) is TensorDictModule for network in networks)
        and isinstance(last, ProbabilisticTensorDictModule)
        and last.distribution_class is IndependentNormal
        and {**last.distribution_kwargs, "tanh_loc": False} == {"tanh_loc": False}
        and last.num_samples is None
        and last._generator is last._generator_key is None
        and len(last.in_keys) == 2
        and list(last.dist_keys) == ["loc", "scale"]
    )


class Gaussian:
    """An actor of `IndependentNormal`, called directly.

    Args:
        actor: networks and, last, the distribution.
    """

    def __init__(self, actor: ProbabilisticTensorDictSequential) -> None:
        modules: Sequence[Any] = list(actor.module)
        self._networks, self._last = modules[:-1], modules[-1]

    def __call__(self, tensordict: TensorDictBase) -> None:
        """Write what the networks say, the action and its log-probability."""
        for network in self._networks:
            out = network.module(*(tensordict.get(key) for key in network.in_keys))
            values = out if isinstance(out, tuple) else (out,)
            for key, value in zip(network.out_keys, values, strict=False):
                tensordict.set(key, value)
        last = self._last
        loc, scale = (tensordict.get(key) for key in last.in_keys)
        action = loc
        if exploration_type() is ExplorationType.RANDOM:
            action = loc + torch.randn_like(loc) * scale
        tensordict.set(last.out_keys[0], action)
        if last.return_log_prob:
            tensordict.set(last.log_prob_keys[0], log_prob(action, loc, scale))


def log_prob(action: Tensor, loc: Tensor, scale: Tensor) -> Tensor:
    """Return a diagonal Gaussian's log-density (N,), as torch's `Normal` rounds it."""
    each = -((action - loc) ** 2) / (2 * scale**2) - scale.log() - HALF_LOG_2PI
    return each.sum(-1)
