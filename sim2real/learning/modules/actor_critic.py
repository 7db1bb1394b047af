"""Actor and critic: what policy-gradient methods train, and the actor alone that acts afterwards.

    policy = ActorCritic(11, 3, low, high, hidden=(64, 64), activation="tanh", log_std=0.0)
    policy.initialize(torch.Generator().manual_seed(0))
    mean, log_std, value = policy(observation)        # (B, 3), (3,), (B,)
    actor = policy.actor(mean=np.zeros(11), std=np.ones(11))
    action = actor(raw_observation)                   # deterministic, within the limits

Both are perceptrons of one shape, kept side by side in one flat parameter vector, so that a layer
of both is one batched product and an optimizer's step a handful of operations.
"""

from __future__ import annotations

from math import prod
from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from sim2real.learning.modules.acting import Actor
from sim2real.learning.modules.perceptrons import Layers, Perceptrons, activated
from sim2real.learning.modules.policy import Activation

Tensor = torch.Tensor
HIDDEN_GAIN, MEAN_GAIN, VALUE_GAIN = 2**0.5, 0.01, 1.0  # as Stable-Baselines3 2.9 initializes


class Weights(NamedTuple):
    """Views of the flat vector; index 0 of a hidden layer is the actor's, 1 the critic's."""

    hidden: Layers
    mean: tuple[Tensor, Tensor]  # (H, A), (A,)
    value: tuple[Tensor, Tensor]  # (H, 1), (1,)
    log_std: Tensor  # (A,)


class ActorCritic(nn.Module):
    """A Gaussian actor whose deviation does not depend on the state, and a critic.

    Args:
        observation_size: O, numbers in an observation.
        action_size: A, numbers in an action.
        action_low: the actions' lower limits, (A,), in the actions' units.
        action_high: the actions' upper limits, (A,).
        hidden: widths of the hidden layers of both.
        activation: the hidden layers' nonlinearity.
        log_std: logarithm of the actions' first standard deviation.

    Raises:
        Sim2RealError: for sizes or names that make no network.
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
        log_std: float,
    ) -> None:
        super().__init__()
        self.observation_size, self.action_size = int(observation_size), int(action_size)
        self.action_low = np.asarray(action_low, np.float64)  # (A,)
        self.action_high = np.asarray(action_high, np.float64)  # (A,)
        self.hidden = tuple(int(width) for width in hidden)
        self.activation: Activation = activation
        self._log_std = log_std
        self.body = Perceptrons(2, (self.observation_size, *self.hidden), activation, "activated")
        last = self.hidden[-1]
        self._heads = [(last, self.action_size), (self.action_size,), (last, 1), (1,)]
        self._heads.append((self.action_size,))
        self._count = self.body.num_parameters + sum(prod(shape) for shape in self._heads)
        self.theta = nn.Parameter(torch.zeros(self._count))  # (P,)
        self._views: tuple[int, Weights] | None = None

    @property
    def shape(self) -> dict[str, int | str | list[int]]:
        """What parameters must fit: sizes and nonlinearity."""
        return {
            "observation_size": self.observation_size,
            "action_size": self.action_size,
            "hidden": list(self.hidden),
            "activation": self.activation,
        }

    def weights(self, flat: Tensor) -> Weights:
        """Return the layers as views of a flat vector (P,): the parameters or their gradient."""
        heads = flat[self.body.num_parameters : self._count]
        heads = heads.split([prod(shape) for shape in self._heads])
        mean, mean_bias, value, value_bias, log_std = (
            head.view(shape) for head, shape in zip(heads, self._heads, strict=True)
        )
        return Weights(self.body.weights(flat), (mean, mean_bias), (value, value_bias), log_std)

    @property
    def present(self) -> Weights:
        """The layers as views of the parameters, without their history for autograd."""
        place = self.theta.data_ptr()
        if self._views is None or self._views[0] != place:
            self._views = place, self.weights(self.theta.detach())
        return self._views[1]

    @torch.no_grad()
    def initialize(self, generator: torch.Generator) -> None:
        """Draw orthogonal weights (Saxe et al. 2014); biases are 0."""
        weights = self.weights(self.theta.zero_())
        for weight, _ in weights.hidden:
            for one in weight:
                _orthogonal(one, HIDDEN_GAIN, generator)
        _orthogonal(weights.mean[0], MEAN_GAIN, generator)
        _orthogonal(weights.value[0], VALUE_GAIN, generator)
        weights.log_std.fill_(self._log_std)

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Map normalized observations (B, O) to means (B, A), log deviations (A,), values (B,)."""
        weights = self.weights(self.theta)
        x = self.body.forward(weights.hidden, observation)[-1]  # (2, B, H)
        mean = torch.addmm(weights.mean[1], x[0], weights.mean[0])
        value = torch.addmm(weights.value[1], x[1], weights.value[0])
        return mean, weights.log_std, value[:, 0]

    @torch.no_grad()
    def mean(self, observation: Tensor) -> Tensor:
        """Map normalized observations (B, O) to means (B, A), without the critic."""
        weights, x = self.present, observation
        for weight, bias in weights.hidden:
            x = torch.addmm(bias[0], x, weight[0])
            x = activated(x, self.activation)
        return torch.addmm(weights.mean[1], x, weights.mean[0])

    def actor(self, mean: np.ndarray, std: np.ndarray) -> Actor:
        """Return the deterministic policy of raw observations, on the CPU.

        Args:
            mean: what normalization subtracts from an observation, (O,).
            std: what it divides by, (O,).
        """
        weights = self.weights(self.theta.detach().cpu())
        layers: list[nn.Module] = []
        for weight, bias in weights.hidden:
            activation = nn.Tanh() if self.activation == "tanh" else nn.ReLU()
            layers += [_linear(weight[0], bias[0, 0]), activation]
        network = nn.Sequential(*layers, _linear(*weights.mean))
        return Actor(network, mean, std, self.action_low, self.action_high)


def _orthogonal(weight: Tensor, gain: float, generator: torch.Generator) -> None:
    """Fill a matrix (in, out) as torch fills its transpose."""
    drawn = torch.empty(weight.shape[1], weight.shape[0])
    weight.copy_(nn.init.orthogonal_(drawn, gain, generator).T)


def _linear(weight: Tensor, bias: Tensor) -> nn.Linear:
    linear = nn.Linear(weight.shape[0], weight.shape[1])
    with torch.no_grad():
        linear.weight.copy_(weight.T)
        linear.bias.copy_(bias)
    return linear
