"""The networks of SAC: an actor of squashed Gaussians and two critics of actions.

    policy = SoftActorCritic(11, 3, low, high, hidden=(256, 256), activation="relu")
    policy.initialize(torch.Generator().manual_seed(0))
    layers = policy.actor_body.forward(policy.actor_weights, observation)
    drawn = draw(layers[-1][0], noise)                # action (B, 3) in (-1, 1), log_prob (B,)

Actions are in units of half the range between their limits, so that each is in (-1, 1).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import torch
from torch import nn
from torchrl.envs import TransformedEnv

from sim2real.learning.modules.acting import Actor
from sim2real.learning.modules.perceptrons import Perceptrons
from sim2real.learning.modules.policy import Activation
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
LOG_STD = (-20.0, 2.0)  # limits of the Gaussians' logarithmic deviation, as Stable-Baselines3 2.9
LOG_2PI = math.log(2 * math.pi)


class Draw(NamedTuple):
    """Actions drawn from B squashed Gaussians, and what their gradient needs."""

    action: Tensor  # (B, A), in (-1, 1)
    log_prob: Tensor  # (B,)
    spread: Tensor  # (B, A): deviation times noise
    held: Tensor  # (B, A) bool: the deviation is at a limit


class SoftActorCritic(nn.Module):
    """An actor and two critics; `target` follows the critics.

    Args:
        observation_size: O, numbers in an observation.
        action_size: A, numbers in an action.
        action_low: the actions' lower limits, (A,), in the actions' units.
        action_high: the actions' upper limits, (A,).
        hidden: widths of the hidden layers of all three.
        activation: the hidden layers' nonlinearity.

    Raises:
        Sim2RealError: for sizes or names that make no network, or limits that are not finite.
    """

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        action_low: np.ndarray,
        action_high: np.ndarray,
        *,
        hidden: tuple[int, ...],
        activation: Activation,
    ) -> None:
        super().__init__()
        self.action_low = np.asarray(action_low, np.float64)  # (A,)
        self.action_high = np.asarray(action_high, np.float64)  # (A,)
        if not np.isfinite([self.action_low, self.action_high]).all():
            raise Sim2RealError("algorithm=sac needs finite action limits; use algorithm=ppo")
        self.observation_size, self.action_size = int(observation_size), int(action_size)
        self.hidden = tuple(int(width) for width in hidden)
        self.activation: Activation = activation
        sizes = (self.observation_size, *self.hidden, 2 * self.action_size)
        self.actor_body = Perceptrons(1, sizes, activation, "linear")
        sizes = (self.observation_size + self.action_size, *self.hidden, 1)
        self.critic_body = Perceptrons(2, sizes, activation, "linear")
        self.actor_theta = nn.Parameter(torch.zeros(self.actor_body.num_parameters))
        self.critic_theta = nn.Parameter(torch.zeros(self.critic_body.num_parameters))
        self.target: Tensor
        self.register_buffer("target", torch.zeros(self.critic_body.num_parameters))

    @property
    def shape(self) -> dict[str, int | str | list[int]]:
        """What parameters must fit: sizes and nonlinearity."""
        return {
            "observation_size": self.observation_size,
            "action_size": self.action_size,
            "hidden": list(self.hidden),
            "activation": self.activation,
        }

    @torch.no_grad()
    def initialize(self, generator: torch.Generator) -> None:
        """Draw weights and biases as torch's linear layers do: uniform within 1 / sqrt(inputs)."""
        for body, theta in (
            (self.actor_body, self.actor_theta),
            (self.critic_body, self.critic_theta),
        ):
            for weight, bias in body.weights(theta):
                reach = weight.shape[1] ** -0.5
                weight.uniform_(-reach, reach, generator=generator)
                bias.uniform_(-reach, reach, generator=generator)
        self.target.copy_(self.critic_theta)

    def distribution(self, observation: Tensor) -> Tensor:
        """Map observations (B, O) to means and logarithmic deviations, (B, 2 A)."""
        weights = self.actor_body.weights(self.actor_theta)
        return self.actor_body.forward(weights, observation)[-1][0]

    def values(self, observation: Tensor, action: Tensor) -> Tensor:
        """Map observations (B, O) and actions (B, A) to both critics' values, (2, B)."""
        weights = self.critic_body.weights(self.critic_theta)
        both = torch.cat([observation, action], dim=-1)
        return self.critic_body.forward(weights, both)[-1][..., 0]

    def actor(self) -> Actor:
        """Return the deterministic policy of raw observations, on the CPU."""
        network: list[nn.Module] = []
        with torch.no_grad():
            for weight, bias in self.actor_body.weights(self.actor_theta.detach().cpu()):
                if network:
                    network.append(nn.Tanh() if self.activation == "tanh" else nn.ReLU())
                is_last = len(network) == 2 * len(self.hidden)
                kept = self.action_size if is_last else weight.shape[2]  # means without deviations
                linear = nn.Linear(weight.shape[1], kept)
                linear.weight.copy_(weight[0, :, :kept].T)
                linear.bias.copy_(bias[0, 0, :kept])
                network.append(linear)
        size = self.observation_size
        limits = (self.action_low, self.action_high)
        return Actor(nn.Sequential(*network), np.zeros(size), np.ones(size), *limits, "tanh")


def soft_actor_critic(
    env: TransformedEnv, *, hidden: tuple[int, ...], activation: Activation
) -> SoftActorCritic:
    """Make the networks for an environment; see `SoftActorCritic`."""
    rows = env.base_env.rows
    sizes = (rows.observation_size, rows.action_size, rows.action_low, rows.action_high)
    return SoftActorCritic(*sizes, hidden=hidden, activation=activation)


def draw(distribution: Tensor, noise: Tensor) -> Draw:
    """Draw actions by noise from N(0, 1), (B, A), from what the actor says, (B, 2 A)."""
    mean, said = distribution.chunk(2, dim=-1)
    log_std = said.clamp(*LOG_STD)
    spread = torch.exp(log_std) * noise
    raw = mean + spread
    gaussian = -0.5 * noise.square() - log_std - 0.5 * LOG_2PI
    # log(1 - tanh(x)^2), in a form that is exact where tanh(x) rounds to 1
    squash = 2 * (math.log(2) - raw - nn.functional.softplus(-2 * raw))
    held = (said < LOG_STD[0]) | (said > LOG_STD[1])
    return Draw(torch.tanh(raw), (gaussian - squash).sum(-1), spread, held)
