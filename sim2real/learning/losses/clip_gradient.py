"""The clipped loss of PPO for perceptrons, and its gradient without autograd.

    gradient = ClipGradient(read_dense(actor), read_dense(critic))
    losses = gradient(samples, settings)              # values, what is logged, and the gradient

`FastClipPPOLoss` puts TorchRL's interface around it; the equations are in its docstring.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import torch
from tensordict.nn import AddStateIndependentNormalScale
from torchrl.objectives.utils import distance_loss

from sim2real.learning.modules.dense import Dense, Trunks, flatten

Tensor = torch.Tensor
LOG_2PI = math.log(2 * math.pi)
SLOPES: dict[str, Callable[[Tensor], Tensor]] = {  # of the distances, by the value's error
    "l2": lambda error: 2 * error,
    "l1": torch.sign,
    "smooth_l1": lambda error: error.clamp(-1, 1),
}


class Samples(NamedTuple):
    """B samples as the loss needs them."""

    actor_input: Tensor  # (B, O)
    critic_input: Tensor  # (B, O)
    action: Tensor  # (B, A)
    log_prob: Tensor  # (B,), under the policy that acted
    advantage: Tensor  # (B,), as the loss sees it
    target: Tensor  # (B,), of the value
    old_value: Tensor | None  # (B,), that the value is clipped around
    shape: torch.Size  # of the tensordict that they were: (B,), or several dimensions


class Settings(NamedTuple):
    """What weighs and limits the losses."""

    limits: tuple[float, float]  # least and largest ratio
    critic_coeff: float  # weight of the critic's loss
    entropy_coeff: float  # weight of the entropy
    distance: str  # of values and targets: a key of SLOPES
    clip_value: float | None  # how far a value may leave the old one
    explained_variance: bool  # whether it is logged


class Losses(NamedTuple):
    """What samples cost, and which way is uphill."""

    values: tuple[Tensor, Tensor, Tensor]  # objective, critic, entropy: numbers
    logged: dict[str, Tensor]
    gradient: Tensor  # (P,): of the objective for the actor, of the critic's loss for the critic
    entropy: Tensor  # (A,): of the entropy's loss by the scale's parameters


class ClipGradient:
    """The losses of an actor and a critic, and their gradients.

    Args:
        actor: its head is an exponential scale that does not depend on the state.
        critic: of one output.
    """

    def __init__(self, actor: Dense, critic: Dense) -> None:
        assert isinstance(actor.head, AddStateIndependentNormalScale)
        floor: Any = actor.head.scale_lb
        self.networks, self._floor = (actor, critic), float(floor)
        self.flat, starts = flatten(self.networks)
        self.middle = starts[1]  # where the critic's parameters begin
        self._trunks = Trunks(self.networks, starts)

    def _renew(self) -> None:
        """Follow parameters that somebody has moved."""
        if not self.flat.renew():
            return
        both = self.flat.vector, torch.zeros_like(self.flat.vector)
        self._slope = both[1]
        self._hidden, self._hidden_slope = (self._trunks.views(x) for x in both)
        self._heads, self._heads_slope = (self._head_views(x) for x in both)

    def _head_views(self, vector: Tensor) -> tuple[Tensor, ...]:
        """Return weights and biases of the means and of the value, and the scale's logarithms."""
        parts, last = self.flat.split(vector), len(self.networks[0].parameters) - 1
        return parts[last - 2], parts[last - 1], parts[-2], parts[-1], parts[last]

    def __call__(self, samples: Samples, settings: Settings) -> Losses:
        """Return the losses of samples and their gradients at the present parameters."""
        self._renew()
        inputs = (samples.actor_input, samples.critic_input)
        layers = self._trunks.forward(self._hidden, inputs)
        upstream = [torch.empty_like(x[-1]) for x in layers]
        hidden = self._trunks.by_network([x[-1] for x in layers])
        to_hidden = self._trunks.by_network(upstream)
        objective, *entropy, acting = self._act(samples, settings, hidden[0], to_hidden[0])
        critic, judging = self._judge(samples, settings, hidden[1], to_hidden[1])
        self._trunks.backward(self._hidden, layers, upstream, self._hidden_slope)
        values = (objective, critic, entropy[0])
        return Losses(values, {**acting, **judging}, self._slope.clone(), entropy[1])

    def _act(
        self, samples: Samples, settings: Settings, hidden: Tensor, to_hidden: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, dict[str, Tensor]]:
        """Return objective, loss of the entropy, its gradient by the scale, and what is logged."""
        weight, bias, _, _, log_scale = self._heads
        weight_slope, bias_slope, _, _, scale_slope = self._heads_slope
        count, actions = samples.action.shape
        raw = log_scale.exp()
        scale = raw.clamp_min(self._floor)
        free = raw >= self._floor  # elsewhere the scale is held at its floor
        scaled = torch.addmm(bias, hidden, weight.T).sub_(samples.action).div_(scale)  # (B, A)
        squared = scaled.square()
        constant = scale.log().sum() + 0.5 * actions * LOG_2PI
        log_ratio = squared.sum(1).mul_(-0.5).sub_(constant).sub_(samples.log_prob)
        ratio = log_ratio.exp()
        inside = ratio.clamp(*settings.limits)
        gain = ratio * samples.advantage
        least = torch.minimum(gain, inside * samples.advantage)
        # beyond the limit on the side that the advantage pulls to, the objective is flat
        step = torch.where(least < gain, 0, gain).div_(count).unsqueeze(1)  # (B, 1)
        to_mean = (scaled * step).div_(scale)
        torch.sum(squared.neg_().add_(1).mul_(step), 0, out=scale_slope)
        scale_slope.mul_(free)
        torch.mm(to_mean.T, hidden, out=weight_slope)
        torch.sum(to_mean, 0, out=bias_slope)
        torch.mm(to_mean, weight, out=to_hidden)
        entropy = constant + 0.5 * actions
        coefficient = -settings.entropy_coeff
        logged = {**_ratios(ratio, inside, log_ratio, samples.shape), "entropy": entropy}
        return least.mean().neg_(), coefficient * entropy, coefficient * free, logged

    def _judge(
        self, samples: Samples, settings: Settings, hidden: Tensor, to_hidden: Tensor
    ) -> tuple[Tensor, dict[str, Tensor]]:
        """Return the critic's loss and what is logged."""
        _, _, weight, bias, _ = self._heads
        _, _, weight_slope, bias_slope, _ = self._heads_slope
        value = torch.addmm(bias, hidden, weight.T)[:, 0]
        error = value - samples.target
        cost = distance_loss(samples.target, value, settings.distance)
        slope, logged = SLOPES[settings.distance](error), {}
        if settings.clip_value is not None:
            cost, slope, logged = _clipped(samples, settings, value, cost, slope)
        to_value = slope.mul_(settings.critic_coeff / len(value)).unsqueeze(1)
        torch.mm(to_value.T, hidden, out=weight_slope)
        torch.sum(to_value, 0, out=bias_slope)
        torch.mm(to_value, weight, out=to_hidden)
        if settings.explained_variance:
            target = samples.target.view(*samples.shape, 1)
            both = torch.stack([error.view_as(target), target])
            left, total = torch.var(both, correction=0, dim=1)
            logged["explained_variance"] = 1 - left / (total + torch.finfo(target.dtype).eps)
        return cost.mean() * settings.critic_coeff, logged


def _ratios(
    ratio: Tensor, inside: Tensor, log_ratio: Tensor, shape: torch.Size
) -> dict[str, Tensor]:
    """Return what is logged of the ratios (B,) of samples of a shape."""
    squared = ratio.square()
    means = torch.stack([log_ratio, ratio, squared, (inside != ratio).to(ratio.dtype)]).mean(1)
    log_mean, mean, square_mean, moved = means.unbind()
    effective = mean.square() / square_mean
    if len(shape) > 1:  # along the first dimension
        count = shape[0]
        effective = ratio.view(shape).sum(0).square() / squared.view(shape).sum(0) / count
    return {
        "clip_fraction": moved,
        "kl_approx": -log_mean,
        "ESS": effective,
        "max_ratio": ratio.max(),
        "mean_ratio": mean,
    }


def _clipped(
    samples: Samples, settings: Settings, value: Tensor, cost: Tensor, slope: Tensor
) -> tuple[Tensor, Tensor, dict[str, Tensor]]:
    """Return the larger of the costs of the value and of the value near the old one."""
    assert samples.old_value is not None and settings.clip_value is not None
    moved = value - samples.old_value
    limited = moved.clamp(-settings.clip_value, settings.clip_value)
    near = samples.old_value + limited
    near_cost = distance_loss(samples.target, near, settings.distance)
    outside = limited != moved
    near_slope = SLOPES[settings.distance](near - samples.target).masked_fill(outside, 0)
    logged = {"value_clip_fraction": outside.to(value.dtype).mean()}
    slope = torch.where(near_cost > cost, near_slope, slope)
    return torch.maximum(cost, near_cost), slope, logged
