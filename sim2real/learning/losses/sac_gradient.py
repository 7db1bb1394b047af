"""The losses of SAC for perceptrons, and their gradients without autograd.

    gradient = SACGradient(read_dense(actor), actor_parameters, critics, targets)
    found = gradient(transitions, settings)           # values, and gradients by parameter

`FastSACLoss` puts TorchRL's interface around it; the equations are in its docstring. All losses are
taken at the same parameters, so states and next states go through the actor in one product, and
taken and drawn actions through the critics. What the actor's loss would do to the critics'
parameters is never computed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import nn
from torchrl.objectives.utils import distance_loss

from sim2real.learning.losses.clip_gradient import SLOPES
from sim2real.learning.modules.dense import Dense
from sim2real.learning.modules.heads import NormalHead
from sim2real.learning.modules.perceptrons import Layers, Perceptrons

Tensor = torch.Tensor
LOG_2PI = math.log(2 * math.pi)


class Transitions(NamedTuple):
    """B transitions."""

    observation: Tensor  # (B, O)
    action: Tensor  # (B, A), in (-1, 1)
    reward: Tensor  # (B,)
    next_observation: Tensor  # (B, O)
    terminated: Tensor  # (B,): whether the task ended the episode


class Settings(NamedTuple):
    """What the losses need beside transitions."""

    gamma: Tensor  # discount of a step
    alpha: Tensor  # temperature: how much entropy counts
    distance: str  # of values and targets: a key of SLOPES


class Losses(NamedTuple):
    """What transitions cost, and which way is uphill."""

    values: tuple[Tensor, Tensor]  # of the actor and of the critics: numbers
    log_prob: Tensor  # (B,), of the actions drawn in the states
    error: Tensor  # (B,), the largest of the critics'
    actor: list[Tensor]  # gradients by the actor's parameters
    critic: list[Tensor]  # gradients by the critics' parameters


class Draw(NamedTuple):
    """Actions drawn from B squashed Gaussians, and what their gradient needs."""

    action: Tensor  # (B, A), in (-1, 1)
    log_prob: Tensor  # (B,)
    spread: Tensor  # (B, A): deviation times noise
    held: Tensor  # (B, A) bool: the deviation is at a limit


class SACGradient:
    """The losses of an actor and K critics, and their gradients.

    Args:
        actor: its head is a `NormalHead`.
        critic: the shape of each critic; it reads observations, then actions.
        count: K.
    """

    def __init__(self, actor: Dense, critic: Dense, count: int) -> None:
        assert isinstance(actor.head, NormalHead)
        self._head, self._observations = actor.head, actor.sizes[0]
        self._actor = Perceptrons(1, actor.sizes, actor.activation, "linear")
        self._critic = Perceptrons(count, critic.sizes, critic.activation, "linear")

    @torch.no_grad()
    def __call__(
        self,
        batch: Transitions,
        settings: Settings,
        actor: Sequence[Tensor],
        critic: Sequence[Tensor],
        target: Sequence[Tensor],
    ) -> Losses:
        """Return the losses of transitions and their gradients.

        Args:
            batch: the transitions.
            settings: discount, temperature and distance.
            actor: weights and biases of the actor, (out, in) and (out,) by layer.
            critic: those of the critics, (K, out, in) and (K, out).
            target: those of the critics that the targets are from.
        """
        body, count = self._critic, len(batch.reward)
        weights, critics = _stacked(actor), _views(critic)
        states = torch.cat([batch.observation, batch.next_observation])  # (2 B, O)
        layers = self._actor.forward(weights, states)
        drawn = self._draw(layers[-1][0])
        wanted = self._targets(batch, settings, drawn, _views(target))  # (B,)
        taken = torch.cat([batch.observation, batch.action], dim=1)
        chosen = torch.cat([batch.observation, drawn.action[:count]], dim=1)
        outputs = body.forward(critics, torch.cat([taken, chosen]))  # (K, 2 B, ...)
        error = outputs[-1][:, :count, 0] - wanted  # (K, B)
        upstream = SLOPES[settings.distance](error).div_(count).unsqueeze(2)
        critic_slopes = [torch.empty_like(p) for p in critic]
        body.backward(critics, [x[:, :count] for x in outputs], upstream, _views(critic_slopes))
        least, uphill = self._uphill(critics, [x[:, count:] for x in outputs])
        own = Draw(*(x[:count] for x in drawn))
        onward = _through_draw(own, uphill.neg_(), settings.alpha / count)
        actor_slopes = [torch.empty_like(p) for p in actor]
        acting = [x[:, :count] for x in layers]
        self._actor.backward(weights, acting, onward[None], _stacked(actor_slopes))
        predicted = outputs[-1][:, :count, 0]
        cost = distance_loss(predicted, wanted.expand_as(predicted), settings.distance)
        values = (settings.alpha * own.log_prob - least).mean(), cost.sum(0).mean()
        return Losses(values, own.log_prob, error.abs().amax(0), actor_slopes, critic_slopes)

    def _draw(self, said: Tensor) -> Draw:
        """Draw actions of next states, then of states, from what the actor says, (2 B, 2 A)."""
        mean, raw_log_std = said.chunk(2, dim=1)
        after, own = (torch.randn_like(half) for half in mean.chunk(2))
        noise = torch.cat([own, after])
        head = self._head
        log_std = raw_log_std.clamp(head.log_std_min, head.log_std_max)
        spread = torch.exp(log_std) * noise
        raw = mean + spread
        gaussian = -0.5 * noise.square() - log_std - 0.5 * LOG_2PI
        # log(1 - tanh(x)^2), in a form that is exact where tanh(x) rounds to 1
        squash = 2 * (math.log(2) - raw - nn.functional.softplus(-2 * raw))
        return Draw(torch.tanh(raw), (gaussian - squash).sum(1), spread, log_std != raw_log_std)

    def _targets(
        self, batch: Transitions, settings: Settings, drawn: Draw, target: Layers
    ) -> Tensor:
        """Return what the critics should say of the taken actions, (B,)."""
        count = len(batch.reward)
        after = torch.cat([batch.next_observation, drawn.action[count:]], dim=1)
        values = self._critic.forward(target, after)[-1]  # (K, B, 1)
        worth = values.amin(0)[:, 0] - settings.alpha * drawn.log_prob[count:]
        return batch.reward + settings.gamma * ~batch.terminated * worth

    def _uphill(self, critics: Layers, outputs: list[Tensor]) -> tuple[Tensor, Tensor]:
        """Return the smallest values (B,), and the gradient by the actions (B, A) of their mean."""
        least, which = outputs[-1].min(0, keepdim=True)  # (1, B, 1)
        chosen = torch.zeros_like(outputs[-1]).scatter_(0, which, 1 / least.shape[1])
        slope = self._critic.backward(critics, outputs, chosen, None, to_input=True)
        return least[0, :, 0], slope.sum(0)[:, self._observations :]


def _stacked(parameters: Sequence[Tensor]) -> Layers:
    """Return one network's weights (out, in) and biases (out,) as a stack of one."""
    return _views([p[None] for p in parameters])


def _views(parameters: Sequence[Tensor]) -> Layers:
    """Return weights (K, out, in) and biases (K, out) as `Perceptrons` takes them."""
    weights, biases = parameters[::2], parameters[1::2]
    return [(w.transpose(1, 2), b.unsqueeze(1)) for w, b in zip(weights, biases, strict=True)]


def _through_draw(drawn: Draw, gradient: Tensor, weight: Tensor) -> Tensor:
    """Carry a gradient of actions, and `weight` times that of log_prob, to the actor's (B, 2 A)."""
    action = drawn.action
    raw = gradient * (1 - action.square()) + 2 * weight * action
    log_std = (raw * drawn.spread - weight).masked_fill_(drawn.held, 0)
    return torch.cat([raw, log_std], dim=1)
