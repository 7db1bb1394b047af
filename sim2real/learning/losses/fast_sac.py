"""TorchRL's SAC loss, faster: the gradient is written out instead of traced.

    loss = FastSACLoss(actor, qvalue, loss_function="l2")
    loss.make_value_estimator(gamma=0.99)
    losses = loss(minibatch)                          # the keys of SACLoss
    (losses["loss_actor"] + losses["loss_qvalue"] + losses["loss_alpha"]).backward()

With a from the actor, y = r + gamma (1 - terminated) (min Q'(s', a') - alpha log p(a'|s'))
(Haarnoja et al. 2018, arXiv:1812.05905):

    loss_qvalue = sum over the critics of mean(distance(Q(s, b), y)), b the action that was taken
    loss_actor = mean(alpha log p(a|s) - min Q(s, a))
    loss_alpha = -log(alpha) mean(log p(a|s) + target entropy)

It draws as `SACLoss` does: after the same seed both get the same actions. On another device than
the CPU `SACLoss` itself computes.
"""

from typing import Any

import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import ProbabilisticTensorDictModule, TensorDictModuleBase, dispatch
from torchrl.modules import TanhNormal
from torchrl.objectives import SACLoss
from torchrl.objectives.value import TD0Estimator

from sim2real.learning.losses.clip_gradient import SLOPES
from sim2real.learning.losses.sac_gradient import Losses, SACGradient, Settings, Transitions
from sim2real.learning.modules.arrays import Array
from sim2real.learning.modules.dense import Dense, read_dense
from sim2real.learning.modules.heads import NormalHead
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
SUPPORTED: dict[str, tuple[Any, ...]] = {  # the values that it knows of options it has in part
    "delay_actor": (False,),
    "skip_done_states": (False,),
    "reduction": (None, "mean"),
    "loss_function": tuple(SLOPES),
}


class FastSACLoss(SACLoss):
    """`SACLoss` of an MLP with a squashed Gaussian, and of MLPs as critics.

    Args:
        actor_network: a `ProbabilisticActor` of `TanhNormal` in (-1, 1) over `MLP` and
            `NormalHead`.
        qvalue_network: a `ValueOperator` over `MLP`, of observations and actions in this order; it
            is duplicated. Or a list of them.
        options: those of `SACLoss`.

    Raises:
        Sim2RealError: for networks that it cannot differentiate, and for options that it does not
            have; `SACLoss` takes those.
    """

    def __init__(self, actor_network: Any, qvalue_network: Any, **options: Any) -> None:
        if options.pop("value_network", None) is not None:
            _refuse("value_network (the first version of SAC)")
        for name, value in options.items():
            if name in SUPPORTED and value not in SUPPORTED[name]:
                _refuse(f"{name}={value!r}")
        critics = qvalue_network if isinstance(qvalue_network, list) else [qvalue_network]
        actor, *shapes = (read_dense(one, "loss=sac") for one in (actor_network, *critics))
        _refuse_networks(actor_network, actor, shapes)
        super().__init__(actor_network, qvalue_network, **options)
        self._gradient, self._actor = SACGradient(actor, shapes[0]), actor
        self._names = _names(critics[0], shapes[0])

    @dispatch  # type: ignore[arg-type]
    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Return the losses of transitions, and write their errors under the priority's key."""
        actor = [p for layer in self._actor.linears for p in (layer.weight, layer.bias)]
        if actor[0].device.type != "cpu":
            return super().forward(tensordict)
        self._refuse_weights(tensordict)
        critic = [self.qvalue_network_params.get(name) for name in self._names]
        target = [self.target_qvalue_network_params.get(name) for name in self._names]
        alpha = self._alpha
        found = self._gradient(
            self._transitions(tensordict),
            Settings(float(self._discount()), float(alpha.detach()), self.loss_function),
            *([p.detach().numpy() for p in group] for group in (actor, critic, target)),
        )
        error, log_prob = torch.from_numpy(found.error), torch.from_numpy(found.log_prob)
        tensordict.set(self.tensor_keys.priority, error.view(tensordict.batch_size))
        loss_actor, loss_qvalue = _HandOut.apply(found, *actor, *critic)
        losses = {
            "loss_actor": loss_actor,
            "loss_qvalue": loss_qvalue,
            "loss_alpha": self._alpha_loss(log_prob).mean(),
            "alpha": alpha,
            "entropy": -log_prob.mean(),
        }
        return TensorDict._new_unsafe(losses, batch_size=torch.Size([]))  # type: ignore[arg-type]

    def _refuse_weights(self, tensordict: TensorDictBase) -> None:
        if self._maybe_get_priority_weight(tensordict) is not None:
            _refuse("weights of samples")
        if any(tensordict.get(key, None) is not None for key in self._loss_mask_keys()):
            _refuse("masked samples")

    def _discount(self) -> Tensor:
        estimator: Any = self.value_estimator
        if type(estimator) is not TD0Estimator or estimator.average_rewards:
            _refuse("another value estimator than TD0")
        return estimator.gamma

    def _transitions(self, tensordict: TensorDictBase) -> Transitions:
        keys, after = self.tensor_keys, tensordict.get("next")
        return Transitions(
            _joined(tensordict, self._actor.in_keys),
            tensordict.get(keys.action).flatten(0, -2).numpy(),
            after.get(keys.reward).flatten().numpy(),
            _joined(after, self._actor.in_keys),
            after.get(keys.terminated).flatten().numpy(),
        )


class _HandOut(torch.autograd.Function):
    """Losses whose gradient is known."""

    @staticmethod
    def forward(ctx: Any, found: Losses, *_: Tensor) -> tuple[Tensor, ...]:
        ctx.found = found
        ctx.set_materialize_grads(False)
        dtype = found.log_prob.dtype
        return tuple(torch.from_numpy(np.array(value, dtype)) for value in found.values)

    @staticmethod
    def backward(ctx: Any, *upstream: Tensor | None) -> Any:
        """Weigh the gradients of both losses by what comes from above."""
        actor, critic = upstream
        return None, *_weighted(ctx.found.actor, actor), *_weighted(ctx.found.critic, critic)


def _weighted(gradients: list[Array], weight: Tensor | None) -> list[Tensor | None]:
    if weight is None:
        return [None] * len(gradients)
    return [torch.from_numpy(gradient * float(weight)) for gradient in gradients]


def _joined(tensordict: TensorDictBase, keys: Any) -> Array:
    """Return entries side by side, (B, O)."""
    parts: list[Any] = [tensordict.get(key) for key in keys]
    whole = parts[0] if len(parts) == 1 else torch.cat(parts, dim=-1)
    return whole.flatten(0, -2).numpy()


def _names(critic: TensorDictModuleBase, network: Dense) -> list[tuple[str, ...]]:
    """Return the places of weights and biases among a critic's parameters, by layer."""
    places = {id(p): tuple(name.split(".")) for name, p in critic.named_parameters()}
    return [places[id(p)] for layer in network.linears for p in (layer.weight, layer.bias)]


def _refuse_networks(actor_network: Any, actor: Dense, critics: list[Dense]) -> None:
    """Raise Sim2RealError for an actor that is not a squashed Gaussian, or other critics."""
    last = actor_network[-1]
    known = {"low": -1.0, "high": 1.0, "tanh_loc": False}
    if not isinstance(last, ProbabilisticTensorDictModule):
        _refuse("an actor without a distribution")
    if last.distribution_class is not TanhNormal:
        _refuse(f"actor of {getattr(last.distribution_class, '__name__', 'another law')}")
    for name, value in last.distribution_kwargs.items():
        if name != "safe_tanh" and not bool(torch.all(torch.as_tensor(value) == known.get(name))):
            _refuse(f"actor of TanhNormal with {name}={value}; scale actions by ActionScaling")
    if not isinstance(actor.head, NormalHead) or actor.sizes[-1] % 2:
        _refuse("actor without a NormalHead at its end")
    wanted = (*actor.in_keys, last.out_keys[0])
    if any(critic.in_keys != wanted or critic.head is not None for critic in critics):
        _refuse(f"critic of {list(critics[0].in_keys)}, but of {list(wanted)}")
    if len({(critic.sizes, critic.activation) for critic in critics}) > 1:
        _refuse("critics of different shapes")


def _refuse(what: str) -> None:
    raise Sim2RealError(f"loss=fast_sac supports no {what}; use loss=sac")
