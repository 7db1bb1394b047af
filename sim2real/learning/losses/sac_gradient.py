"""The losses of SAC for perceptrons, and their gradients without autograd.

    gradient = SACGradient(read_dense(actor), read_dense(critic))
    found = gradient(transitions, settings, actor_parameters, critics, targets)

`FastSACLoss` puts TorchRL's interface around it; the equations are in its docstring. All losses are
taken at the same parameters, so states and next states go through the actor in one product, and
taken and drawn actions through each critic. What the actor's loss would do to the critics'
parameters is never computed. All of it is NumPy on the memory of torch's tensors; see `ArrayMLP`.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch

from sim2real.learning.losses.clip_gradient import DISTANCES, SLOPES
from sim2real.learning.modules.arrays import Array, ArrayLayers, ArrayMLP
from sim2real.learning.modules.dense import Dense
from sim2real.learning.modules.heads import NormalHead

LOG_2PI = math.log(2 * math.pi)


class Transitions(NamedTuple):
    """B transitions."""

    observation: Array  # (B, O)
    action: Array  # (B, A), in (-1, 1)
    reward: Array  # (B,)
    next_observation: Array  # (B, O)
    terminated: Array  # (B,): whether the task ended the episode


class Settings(NamedTuple):
    """Numbers of the losses."""

    gamma: float  # discount of a step
    alpha: float  # temperature: how much entropy counts
    distance: str  # of values and targets: a key of DISTANCES


class Losses(NamedTuple):
    """The losses of transitions, and their gradient."""

    values: tuple[Any, Any]  # of the actor and of the critics: numbers
    log_prob: Array  # (B,), of the actions drawn in the states
    error: Array  # (B,), the largest of the critics'
    actor: list[Array]  # gradients by the actor's parameters
    critic: list[Array]  # gradients by the critics' parameters, (K, ...)


class Draw(NamedTuple):
    """Actions drawn from B squashed Gaussians, and what their gradient needs."""

    action: Array  # (B, A), in (-1, 1)
    log_prob: Array  # (B,)
    spread: Array  # (B, A): deviation times noise
    held: Array  # (B, A) bool: the deviation is at a limit


class SACGradient:
    """The losses of an actor and K critics on the CPU, and their gradients.

    Args:
        actor: its head is a `NormalHead`.
        critic: the shape of each critic; it reads observations, then actions.
    """

    def __init__(self, actor: Dense, critic: Dense) -> None:
        assert isinstance(actor.head, NormalHead)
        self._head, self._observations = actor.head, actor.sizes[0]
        self._actor, self._critic = ArrayMLP(actor.activation), ArrayMLP(critic.activation)

    def __call__(
        self,
        batch: Transitions,
        settings: Settings,
        actor: Sequence[Array],
        critic: Sequence[Array],
        target: Sequence[Array],
    ) -> Losses:
        """Return the losses of transitions and their gradients.

        Args:
            batch: the transitions.
            settings: discount, temperature and distance.
            actor: weights and biases of the actor, (out, in) and (out,) by layer.
            critic: those of the critics, (K, out, in) and (K, out).
            target: those of the critics that the targets are from.
        """
        count, weights = len(batch.reward), ArrayMLP.layers(actor)
        states = np.concatenate([batch.observation, batch.next_observation])  # (2 B, O)
        layers = self._actor.forward(weights, states)
        drawn = self._draw(layers[-1])
        own = Draw(*(x[:count] for x in drawn))
        wanted = self._targets(batch, settings, drawn, target)  # (B,)
        taken = np.concatenate([batch.observation, batch.action], 1)
        chosen = np.concatenate([batch.observation, own.action], 1)
        both, critics = np.concatenate([taken, chosen]), _each(critic)
        outputs = [self._critic.forward(one, both) for one in critics]  # by critic
        error = np.stack([x[-1][:count, 0] - wanted for x in outputs])  # (K, B)
        critic_slopes = [np.empty_like(p) for p in critic]
        upstream = SLOPES[settings.distance](error) / count
        for one, seen, slopes, gradient in zip(
            critics, outputs, _each(critic_slopes), upstream, strict=True
        ):
            self._critic.backward(one, [x[:count] for x in seen], gradient[:, None], slopes)
        least, uphill = self._uphill(critics, [[x[count:] for x in seen] for seen in outputs])
        onward = _through_draw(own, -uphill, settings.alpha / count)
        actor_slopes = [np.empty_like(p) for p in actor]
        seen = [x[:count] for x in layers]
        self._actor.backward(weights, seen, onward, ArrayMLP.layers(actor_slopes))
        cost = DISTANCES[settings.distance](error)
        values = (settings.alpha * own.log_prob - least).mean(), cost.sum(0).mean()
        return Losses(values, own.log_prob, abs(error).max(0), actor_slopes, critic_slopes)

    def _draw(self, said: Array) -> Draw:
        """Draw actions of next states, then of states, from what the actor says, (2 B, 2 A)."""
        mean, raw_log_std = np.split(said, 2, axis=1)
        like = torch.from_numpy(mean[: len(mean) // 2])
        after, own = (torch.randn_like(like).numpy() for _ in range(2))
        noise = np.concatenate([own, after])
        log_std = np.clip(raw_log_std, self._head.log_std_min, self._head.log_std_max)
        spread = np.exp(log_std) * noise
        raw = mean + spread
        gaussian = -0.5 * noise * noise - log_std - 0.5 * LOG_2PI
        # log(1 - tanh(x)^2), in a form that is exact where tanh(x) rounds to 1
        squash = 2 * (math.log(2) - raw - np.logaddexp(0, -2 * raw))
        return Draw(np.tanh(raw), (gaussian - squash).sum(1), spread, log_std != raw_log_std)

    def _targets(
        self, batch: Transitions, settings: Settings, drawn: Draw, target: Sequence[Array]
    ) -> Array:
        """Return the critics' targets for the taken actions, (B,)."""
        count = len(batch.reward)
        after = np.concatenate([batch.next_observation, drawn.action[count:]], 1)
        values = [self._critic.forward(one, after)[-1][:, 0] for one in _each(target)]
        worth = np.minimum.reduce(values) - settings.alpha * drawn.log_prob[count:]
        return batch.reward + np.where(batch.terminated, 0, settings.gamma * worth)

    def _uphill(
        self, critics: list[ArrayLayers], outputs: list[list[Array]]
    ) -> tuple[Array, Array]:
        """Return the smallest values (B,), and the gradient by the actions (B, A) of their mean."""
        values = np.stack([x[-1][:, 0] for x in outputs])  # (K, B)
        least, slope = values.argmin(0), 0.0
        for number, (one, seen) in enumerate(zip(critics, outputs, strict=True)):
            chosen = (least == number).astype(values.dtype)[:, None] / len(least)
            slope = slope + self._critic.backward(one, seen, chosen, None, to_input=True)
        return values.min(0), np.asarray(slope)[:, self._observations :]


def _each(parameters: Sequence[Array]) -> list[ArrayLayers]:
    """Return the layers of each of K networks of weights (K, out, in) and biases (K, out)."""
    return [ArrayMLP.layers([p[k] for p in parameters]) for k in range(len(parameters[0]))]


def _through_draw(drawn: Draw, gradient: Array, weight: float) -> Array:
    """Carry a gradient of actions, and `weight` times that of log_prob, to the actor's (B, 2 A)."""
    action = drawn.action
    raw = gradient * (1 - action * action) + 2 * weight * action
    log_std = np.where(drawn.held, 0, raw * drawn.spread - weight)
    return np.concatenate([raw, log_std], 1)
