"""TorchRL's clipped PPO loss, faster: the gradient is written out instead of traced.

    loss = FastClipPPOLoss(actor, critic, clip_epsilon=0.2, loss_critic_type="l2")
    losses = loss(minibatch)                          # the keys of ClipPPOLoss
    (losses["loss_objective"] + losses["loss_critic"] + losses["loss_entropy"]).backward()

With the ratio r of new to old probability, clipped to c(r) (Schulman et al. 2017, equations 7, 9):

    loss_objective = -mean(min(r A, c(r) A))
    loss_critic = critic_coeff mean(distance(V, R))
    loss_entropy = -entropy_coeff H

A minibatch of 64 and two layers of 64 are so little work that calling it costs more than doing it.
So `forward` computes the gradient along with the losses, in NumPy, and autograd only hands it out.
On another device than the CPU `ClipPPOLoss` itself computes.
"""

import math
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import (
    AddStateIndependentNormalScale,
    ProbabilisticTensorDictModule,
    TensorDictModuleBase,
    dispatch,
)
from torchrl.modules import IndependentNormal
from torchrl.objectives import ClipPPOLoss

from sim2real.learning.losses.clip_gradient import SLOPES, ClipGradient, Losses, Samples, Settings
from sim2real.learning.modules.arrays import Array
from sim2real.learning.modules.dense import Dense, read_dense
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
TINY = torch.finfo(torch.float32).resolution  # least deviation that advantages are divided by
COEFFICIENTS = (  # what a schedule may change of a loss
    "clip_epsilon",
    "clip_epsilon_low",
    "clip_epsilon_high",
    "critic_coeff",
    "entropy_coeff",
    "clip_value",
)
SUPPORTED: dict[str, tuple[Any, ...]] = {  # the values that it knows of options it has in part
    "normalize_advantage_exclude_dims": ((), []),
    "advantage_norm": (None,),
    "reduction": (None, "mean"),
    "delay_actor": (False,),
    "max_importance_ratio": (None,),
}


class FastClipPPOLoss(ClipPPOLoss):
    """`ClipPPOLoss` of an MLP with a state-independent scale, and of an MLP as critic.

    Args:
        actor_network: a `ProbabilisticActor` of `IndependentNormal` over `MLP` and
            `AddStateIndependentNormalScale` (exponential).
        critic_network: a `ValueOperator` over `MLP`.
        options: those of `ClipPPOLoss`.

    Raises:
        Sim2RealError: for networks that it cannot differentiate, and for options that it does not
            have; `ClipPPOLoss` takes those.

    Attributes:
        own: its name among the choices of a loss.
        general: the choice with the same objective for any networks and options.
    """

    own, general = "loss=fast_clip_ppo", "loss=clip_ppo"

    def __init__(
        self,
        actor_network: TensorDictModuleBase | None = None,
        critic_network: TensorDictModuleBase | None = None,
        **options: Any,
    ) -> None:
        networks = [options.pop("actor", actor_network), options.pop("critic", critic_network)]
        for name, value in _unsupported(options).items():
            self._refuse(f"loss.{name}={value!r}")
        if None in networks:
            raise Sim2RealError(f"{self.own}: there is no critic; give the policy one")
        actor, critic = (read_dense(network, self.general) for network in networks)
        if what := _other_distribution(networks[0], actor):
            self._refuse(f"actor of {what}")
        if critic.head is not None or critic.sizes[-1] != 1:
            self._refuse("critic that does not end in a linear layer of one value")
        super().__init__(*networks, **options)
        self._gradient, self._present = ClipGradient(actor, critic), []
        if {id(p) for p in self.parameters()} != {id(p) for p in self._gradient.flat.parameters}:
            raise Sim2RealError("loss: a network has parameters other than those of its layers")

    @dispatch  # type: ignore[arg-type]
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Return the losses of a minibatch, and what is logged of it."""
        if self._gradient.flat.parameters[0].device.type != "cpu":
            return super().forward(tensordict)
        found = self._gradient(self._samples(tensordict), self._settings())
        values = _HandOut.apply(found, self._gradient, *self._gradient.flat.parameters)
        names = ("loss_objective", "loss_critic", "loss_entropy")
        out = {**dict(zip(names, values, strict=True)), **_tensors(found)}
        if not self.entropy_bonus:
            out = {name: value for name, value in out.items() if "entropy" not in name}
        return TensorDict._new_unsafe(out, batch_size=torch.Size([]))  # type: ignore[arg-type]

    def _refuse(self, what: str) -> None:
        raise Sim2RealError(f"{self.own} supports no {what}; use {self.general}")

    def _settings(self) -> Settings:
        """Return the settings as numbers, read again where a schedule has changed one."""
        buffers = [self._buffers.get(name) for name in COEFFICIENTS]
        present = [(id(x), None if x is None else x._version) for x in buffers]
        if present != self._present:
            self._present = present
            low, high = (math.exp(float(x)) for x in self._clip_bounds)
            critic, entropy, clip = (None if x is None else float(x) for x in buffers[3:])
            assert critic is not None and entropy is not None
            self._numbers = Settings(
                (low, high),
                critic,
                entropy,
                self.loss_critic_type,
                clip,
                self.log_explained_variance,
            )
        return self._numbers

    def _samples(self, tensordict: TensorDictBase) -> Samples:
        keys = self.tensor_keys
        if any(tensordict.get(key, None) is not None for key in self._loss_mask_keys()):
            self._refuse("masked samples")
        if tensordict.get(keys.advantage, None) is None:
            tensordict = tensordict.clone(False)
            critic = self._cached_critic_network_params_detached
            target = self.target_critic_network_params
            self.value_estimator(tensordict, params=critic, target_params=target)
        shape, (actor, critic) = tensordict.batch_size, self._gradient.networks
        observed = _joined(tensordict, actor)
        action = tensordict.get(keys.action)
        return Samples(
            observed,
            observed if critic.in_keys == actor.in_keys else _joined(tensordict, critic),
            action.flatten(0, -2).numpy(),
            _numbers(tensordict, keys.sample_log_prob),
            self._advantage(_numbers(tensordict, keys.advantage)),
            _numbers(tensordict, keys.value_target),
            _numbers(tensordict, keys.value) if self.clip_value else None,
            shape,
        )

    def _advantage(self, given: Array) -> Array:
        if not self.normalize_advantage or len(given) < 2:
            return given
        off = given - np.add.reduce(given) / len(given)
        deviation = math.sqrt(float(np.dot(off, off)) / (len(off) - 1))
        return off / max(deviation, TINY)


def _unsupported(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options that it does not have, or not with such a value."""
    wrong = {k: v for k, v in options.items() if k in SUPPORTED and v not in SUPPORTED[k]}
    if options.get("critic_coeff", 1.0) in (None, 0):
        wrong["critic_coeff"] = options["critic_coeff"]
    if isinstance(options.get("entropy_coeff"), dict):
        wrong["entropy_coeff"] = options["entropy_coeff"]
    if options.get("loss_critic_type", "l2") not in SLOPES:
        wrong["loss_critic_type"] = options["loss_critic_type"]
    return wrong


def _other_distribution(network: Any, actor: Dense) -> str | None:
    """Return what an actor draws from; None for a Gaussian around an MLP."""
    last, scale = network[-1], actor.head
    if not isinstance(last, ProbabilisticTensorDictModule):
        raise Sim2RealError("loss: the actor ends in no distribution; use a ProbabilisticActor")
    if last.distribution_class is not IndependentNormal:
        return getattr(last.distribution_class, "__name__", repr(last.distribution_class))
    if {**last.distribution_kwargs, "tanh_loc": False} != {"tanh_loc": False}:
        return f"IndependentNormal with {dict(last.distribution_kwargs)}"
    if not isinstance(scale, AddStateIndependentNormalScale) or scale.scale_mapping != "exp":
        return "a scale that is not an exponential AddStateIndependentNormalScale"
    if scale.scale_shape != (actor.sizes[-1],) or not list(scale.parameters()):
        return "a scale that has not one parameter for each action"
    return None


def _joined(tensordict: TensorDictBase, network: Dense) -> Array:
    """Return a network's input, (B, in)."""
    parts = [tensordict.get(key) for key in network.in_keys]
    whole = parts[0] if len(parts) == 1 else torch.cat(parts, dim=-1)
    return whole.flatten(0, -2).numpy()


def _numbers(tensordict: TensorDictBase, key: Any) -> Array:
    """Return an entry of one number a sample, (B,)."""
    return tensordict.get(key).flatten().numpy()


def _tensors(found: Losses) -> dict[str, Tensor]:
    """Return the metrics as tensors; scalars are converted in one call."""
    logged, dtype = found.logged, found.gradient.dtype
    several = {name: x for name, x in logged.items() if isinstance(x, np.ndarray)}
    plain = [name for name in logged if name not in several]
    numbers = torch.from_numpy(np.array([logged[name] for name in plain], dtype)).unbind()
    return dict(zip(plain, numbers, strict=True)) | {
        k: torch.from_numpy(x) for k, x in several.items()
    }


class _HandOut(torch.autograd.Function):
    """Losses whose gradient is known."""

    @staticmethod
    def forward(ctx: Any, found: Losses, of: ClipGradient, *_: Tensor) -> tuple[Tensor, ...]:
        ctx.found, ctx.of = found, of
        ctx.set_materialize_grads(False)
        dtype = found.gradient.dtype
        return tuple(torch.from_numpy(np.array(value, dtype)) for value in found.values)

    @staticmethod
    def backward(ctx: Any, *upstream: Tensor | None) -> Any:
        """Weigh the gradients of the three losses by what comes from above."""
        found, middle = ctx.found, ctx.of.middle
        objective, critic, entropy = (0.0 if x is None else float(x) for x in upstream)
        out = found.gradient.copy()
        for part, weight in ((out[:middle], objective), (out[middle:], critic)):
            if weight != 1:
                part *= weight
        if entropy:
            out[middle - len(found.entropy) : middle] += entropy * found.entropy
        return None, None, *ctx.of.flat.split(torch.from_numpy(out))
