"""An actor's normal law as a pure function of its parameters, for `torch.func`.

    law = FunctionalActor(policy.actor)
    loc, log_scale = law(law.vector(), observation)     # (B, A) each
    product = fisher_product(lambda v: law(v, observation), law.vector())
    product(direction)                                  # (P,)

Modules of tensordicts and losses that hold parameters fight nested differentiation; a function from
one vector (P,) to tensors does not. The vector holds the actor's parameters in their order.
"""

import math
from collections.abc import Callable
from typing import Any

import torch
from tensordict import TensorDictBase
from tensordict.nn import ProbabilisticTensorDictModule, TensorDictModule, TensorDictSequential
from torch import nn
from torch.func import functional_call, vjp
from torchrl.modules import IndependentNormal

from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
Normal = tuple[Tensor, Tensor]  # means and logarithms of the deviations, (..., A) each
HALF_LOG_2PI = 0.5 * math.log(2 * math.pi)


class FunctionalActor:
    """The normal law that an actor's networks write.

    Args:
        actor: networks and, last, an `IndependentNormal`; without a memory.

    Attributes:
        in_keys: the entries that it reads, in the order of its arguments.

    Raises:
        Sim2RealError: for an actor of another distribution, or one that is not a function.
    """

    def __init__(self, actor: Any) -> None:
        *networks, last = _flat(actor)
        plain = all(type(one) is TensorDictModule for one in networks)
        gaussian = isinstance(last, ProbabilisticTensorDictModule) and (
            last.distribution_class is IndependentNormal
        )
        if not plain or not gaussian:
            raise Sim2RealError(
                "policy: a natural gradient needs a normal law around plain networks, without a "
                "memory; use policy=actor_critic"
            )
        self.in_keys = list(actor.in_keys)
        self._chain = _Chain(networks, self.in_keys)
        self._names = [name for name, _ in self._chain.named_parameters()]
        self.parameters = [p for _, p in self._chain.named_parameters()]
        self._sizes = [p.numel() for p in self.parameters]
        self._shapes = [p.shape for p in self.parameters]

    def vector(self) -> Tensor:
        """Return the present parameters, a copy (P,)."""
        return torch.cat([p.detach().flatten() for p in self.parameters])

    @torch.no_grad()
    def load(self, vector: Tensor) -> None:
        """Put parameters (P,) into the actor."""
        for p, part in zip(self.parameters, self.split(vector), strict=True):
            p.copy_(part)

    def read(self, data: TensorDictBase) -> tuple[Tensor, ...]:
        """Return the entries that the law reads."""
        return tuple(data.get(key) for key in self.in_keys)

    def split(self, vector: Tensor) -> list[Tensor]:
        """Return views of a vector (P,) in the shapes of the parameters."""
        parts = vector.split(self._sizes)
        return [part.view(shape) for part, shape in zip(parts, self._shapes, strict=True)]

    def __call__(self, vector: Tensor, *entries: Tensor) -> Normal:
        """Return means and log-deviations for parameters (P,) and entries (..., O)."""
        weights = dict(zip(self._names, self.split(vector), strict=True))
        loc, scale = functional_call(self._chain, weights, entries)
        return loc, scale.log()


class _Chain(nn.Module):
    """Tensordict modules called one after the other on tensors."""

    def __init__(self, networks: list[Any], in_keys: list[Any]) -> None:
        super().__init__()
        self.networks = nn.ModuleList(one.module for one in networks)
        self._keys = [(one.in_keys, one.out_keys) for one in networks]
        self._in_keys = in_keys

    def forward(self, *entries: Tensor) -> tuple[Tensor, Tensor]:
        """Map entries (..., O) to means and deviations, (..., A) each."""
        known: dict[Any, Tensor] = dict(zip(self._in_keys, entries, strict=True))
        for network, (read, written) in zip(self.networks, self._keys, strict=True):
            out = network(*(known[key] for key in read))
            known.update(zip(written, out if isinstance(out, tuple) else (out,), strict=False))
        return known["loc"], known["scale"]


def _flat(module: Any) -> list[Any]:
    """Return the modules of nested sequences in their order."""
    if isinstance(module, TensorDictSequential) or hasattr(module, "module_list"):
        return [one for part in module.module for one in _flat(part)]
    return [module]


def log_prob(law: Normal, action: Tensor) -> Tensor:
    """Return the log-density (...) of actions (..., A) under normal laws."""
    loc, log_scale = law
    squared = ((action - loc) * (-log_scale).exp()).square()
    return (-0.5 * squared - log_scale - HALF_LOG_2PI).sum(-1)


def divergence(new: Normal, old: Normal) -> Tensor:
    """Return the Kullback-Leibler divergence of new from old, KL(new || old), (...) [nat]."""
    (loc, log_scale), (old_loc, old_log_scale) = new, old
    apart = log_scale - old_log_scale
    squared = (2 * apart).exp() + ((loc - old_loc) * (-old_log_scale).exp()).square()
    return (0.5 * squared - apart - 0.5).sum(-1)


def fisher_product(
    function: Callable[[Tensor], Normal], vector: Tensor, weight: float
) -> Callable[[Tensor], Tensor]:
    """Return a function that multiplies vectors by the Fisher matrix of normal distributions.

    It is J^T W J of the laws' means and log-deviations by the parameters, W being 1 / sigma^2 for a
    mean and 2 for a log-deviation: the Hessian of the laws' divergence at no distance (Martens
    2020, section 8). The function is evaluated and differentiated once, not in each product: a
    derivative along a direction is the derivative of the gradient by what it is weighted with.

    Args:
        function: maps parameters (P,) to laws of any shape; how the parameters reach them, such as
            through a step of adaptation, is part of it.
        vector: the parameters, (P,).
        weight: of each law in the sum, such as 1 / B for their mean.
    """
    (loc, log_scale), backward = vjp(function, vector)[:2]
    zero = torch.zeros_like(loc), torch.zeros_like(log_scale)
    _, forward = vjp(lambda weights: backward(weights)[0], zero)[:2]
    precision = (-2 * log_scale.detach()).exp()

    def product(direction: Tensor) -> Tensor:
        ((loc, spread),) = forward(direction)
        return backward((loc * precision * weight, spread * (2 * weight)))[0]

    return product
