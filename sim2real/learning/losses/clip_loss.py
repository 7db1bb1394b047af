"""The loss of PPO and its gradient: by autograd for any network, written out for perceptrons.

    gradient = PerceptronGradient(policy, loss)      # or AutogradGradient
    gradient(minibatch)                              # into policy.theta.grad

With `c` clipping the ratio r of new to old probability (Schulman et al. 2017, equations 7 and 9):

    L = -mean(min(r A, c(r) A)) + critic_coeff mean((V - R)^2) - entropy_coeff H

A minibatch of 64 and two layers of 64 are so little work that calling it costs more than doing it:
the written-out gradient takes a quarter of autograd's time and a twentieth of `ClipPPOLoss`'s,
whose gradient it equals.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import torch

from sim2real.learning.modules.actor_critic import ActorCritic
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
LOG_2PI = math.log(2 * math.pi)
TINY = 1e-8  # keeps advantages that are all equal from dividing by 0, as Stable-Baselines3 does


class Batch(NamedTuple):
    """B samples of experience, float32."""

    observation: Tensor  # (B, O), normalized
    action: Tensor  # (B, A), before clipping to the limits
    log_prob: Tensor  # (B,), under the policy that acted
    advantage: Tensor  # (B,)
    target: Tensor  # (B,), of the value


@dataclass(frozen=True)
class ClipLoss:
    """What the loss consists of.

    Args:
        clip_epsilon: how far the ratio of probabilities may leave 1.
        critic_coeff: weight of the critic's mean squared error.
        entropy_coeff: weight of the entropy.
        normalize_advantage: whether each minibatch's advantages get mean 0 and deviation 1.

    Raises:
        Sim2RealError: for a clip_epsilon that is not above 0.
    """

    clip_epsilon: float
    critic_coeff: float
    entropy_coeff: float
    normalize_advantage: bool

    def __post_init__(self) -> None:
        if not self.clip_epsilon > 0:
            raise Sim2RealError(f"algorithm.clip_epsilon={self.clip_epsilon} must be above 0")

    def advantage(self, batch: Batch) -> Tensor:
        """Return the advantages (B,) as the loss sees them."""
        if not self.normalize_advantage or len(batch.advantage) < 2:
            return batch.advantage
        std, mean = torch.std_mean(batch.advantage)
        return (batch.advantage - mean) / (std + TINY)

    def __call__(self, policy: Network, batch: Batch) -> Tensor:
        """Return the loss of a batch, for autograd."""
        mean, log_std, value = policy(batch.observation)
        ratio = torch.exp(log_prob(batch.action, mean, log_std) - batch.log_prob)
        clipped = ratio.clamp(1 - self.clip_epsilon, 1 + self.clip_epsilon)
        advantage = self.advantage(batch)
        actor = -torch.min(ratio * advantage, clipped * advantage).mean()
        critic = torch.square(value - batch.target).mean()
        return actor + self.critic_coeff * critic - self.entropy_coeff * entropy(log_std)


class Network(Protocol):
    """What the loss needs of a policy."""

    theta: torch.nn.Parameter

    def __call__(self, observation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Map observations (B, O) to means (B, A), log deviations (A,) and values (B,)."""
        ...


def log_prob(action: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
    """Return the logarithm of a diagonal Gaussian's density at actions (B, A), (B,)."""
    scaled = (action - mean) * torch.exp(-log_std)
    return -0.5 * scaled.square().sum(-1) - log_std.sum() - 0.5 * action.shape[-1] * LOG_2PI


def entropy(log_std: Tensor) -> Tensor:
    """Return the entropy of a diagonal Gaussian [nat]."""
    return log_std.sum() + 0.5 * len(log_std) * (1 + LOG_2PI)


class AutogradGradient:
    """The gradient of `ClipLoss` for any network, by autograd.

    Args:
        policy: gets the gradient into `policy.theta.grad`.
        loss: what is differentiated.
    """

    def __init__(self, policy: Network, loss: ClipLoss) -> None:
        self._policy, self._loss = policy, loss

    def __call__(self, batch: Batch) -> None:
        """Write the gradient at the present parameters of a batch's loss."""
        self._policy.theta.grad = None
        with torch.enable_grad():
            self._loss(self._policy, batch).backward()


def make_gradient(policy: Network, loss: ClipLoss) -> AutogradGradient | PerceptronGradient:
    """Return the faster way to differentiate the loss of that policy."""
    if type(policy) is ActorCritic:
        return PerceptronGradient(policy, loss)
    return AutogradGradient(policy, loss)


class PerceptronGradient:
    """The gradient of `ClipLoss` for an `ActorCritic`, written out.

    Args:
        policy: gets the gradient into `policy.theta.grad`.
        loss: what is differentiated.
    """

    def __init__(self, policy: ActorCritic, loss: ClipLoss) -> None:
        self._loss = loss
        theta = policy.theta.detach()
        policy.theta.grad = torch.zeros_like(theta)
        self._weights, self._out = policy.weights(theta), policy.weights(policy.theta.grad)
        self._body = policy.body

    @torch.no_grad()
    def __call__(self, batch: Batch) -> None:
        """Write the gradient at the present parameters of a batch's loss."""
        weights = self._weights
        layers = self._body.forward(weights.hidden, batch.observation)
        actor, critic = layers[-1]
        mean, value = self._through_heads(batch, actor, critic)
        upstream = torch.empty_like(layers[-1])  # (2, B, H)
        torch.mm(mean, weights.mean[0].T, out=upstream[0])
        torch.mm(value, weights.value[0].T, out=upstream[1])
        self._body.backward(weights.hidden, layers, upstream, self._out.hidden)

    def _through_heads(self, batch: Batch, actor: Tensor, critic: Tensor) -> tuple[Tensor, Tensor]:
        """Write the heads' gradients; return those of the means (B, A) and values (B, 1)."""
        loss, weights, out = self._loss, self._weights, self._out
        count = len(batch.advantage)
        mean = torch.addmm(weights.mean[1], actor, weights.mean[0])
        value = torch.addmm(weights.value[1], critic, weights.value[0])
        inverse = torch.exp(-weights.log_std)
        scaled = (batch.action - mean).mul_(inverse)  # (B, A)
        squared = scaled.square()
        constant = weights.log_std.sum() + 0.5 * scaled.shape[1] * LOG_2PI
        ratio = squared.sum(1).mul_(-0.5).sub_(constant).sub_(batch.log_prob).exp_()
        advantage = loss.advantage(batch)
        # beyond the limit on the side that the advantage pulls to, the loss is flat
        limit = torch.clamp(ratio, 1 - loss.clip_epsilon, 1 + loss.clip_epsilon)
        flat = (ratio - limit).mul_(advantage) > 0
        step = (ratio * advantage).masked_fill_(flat, 0).mul_(-1 / count).unsqueeze(1)  # (B, 1)
        to_mean = (scaled * step).mul_(inverse)
        torch.sum(squared.sub_(1).mul_(step), 0, out=out.log_std)
        if loss.entropy_coeff:
            out.log_std.sub_(loss.entropy_coeff)
        to_value = (value - batch.target.unsqueeze(1)).mul_(2 * loss.critic_coeff / count)
        torch.mm(actor.T, to_mean, out=out.mean[0])
        torch.sum(to_mean, 0, out=out.mean[1])
        torch.mm(critic.T, to_value, out=out.value[0])
        torch.sum(to_value, 0, out=out.value[1])
        return to_mean, to_value
