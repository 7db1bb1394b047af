"""Actor and critic that see images: NatureCNN (Mnih et al. 2015) with two heads.

    policy = ConvActorCritic(
        4 * 84 * 84, 3, low, high, size=84, log_std=0.0, precision="float32"
    )
    mean, log_std, value = policy(observation)        # (B, O) flat images in [0, 1]

Both share the features, as Stable-Baselines3's CnnPolicy does; sizes, initialization and heads are
its own, so that results compare.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

from sim2real.learning.modules.acting import Actor
from sim2real.learning.modules.actor_critic import HIDDEN_GAIN, MEAN_GAIN, VALUE_GAIN
from sim2real.runs.errors import Sim2RealError

Tensor = torch.Tensor
LAYERS = ((32, 8, 4), (64, 4, 2), (64, 3, 1))  # channels, kernel, stride: NatureCNN
FEATURES = 512
SMALLEST = 36  # px: below, a convolution has nothing left to see


class Parts(NamedTuple):
    """Views of the flat vector."""

    layers: list[tuple[Tensor, Tensor]]  # weights and biases of the convolutions, then the dense
    mean: tuple[Tensor, Tensor]  # (A, F), (A,)
    value: tuple[Tensor, Tensor]  # (1, F), (1,)
    log_std: Tensor  # (A,)


class ConvActorCritic(nn.Module):
    """A Gaussian actor whose deviation does not depend on the state, and a critic, over images.

    Args:
        observation_size: numbers in an observation, channels times size times size.
        action_size: A, numbers in an action.
        action_low: the actions' lower limits, (A,), in the actions' units.
        action_high: the actions' upper limits, (A,).
        size: of the square images [px].
        log_std: logarithm of the actions' first standard deviation.
        precision: of the products that make the features; weights, heads and optimizer keep
            float32.

    Raises:
        Sim2RealError: for observations that are no images of that size, images too small, or a
            precision of another name.
    """

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        action_low: np.ndarray,
        action_high: np.ndarray,
        *,
        size: int,
        log_std: float,
        precision: Literal["float32", "bfloat16"],
    ) -> None:
        super().__init__()
        if precision not in ("float32", "bfloat16"):
            raise Sim2RealError(
                f"policy.precision={precision} is not known; it is float32 or bfloat16"
            )
        if size < SMALLEST:
            raise Sim2RealError(
                f"policy.size={size} px is too small for this network; it takes {SMALLEST} or more"
            )
        self.channels, rest = divmod(int(observation_size), size * size)
        if rest or not self.channels:
            raise Sim2RealError(
                f"observations of {observation_size} numbers are no images of {size} x {size} px; "
                "set policy.size to env.size, and use an environment with pixels"
            )
        self.observation_size, self.action_size, self.size = observation_size, action_size, size
        self.action_low = np.asarray(action_low, np.float64)  # (A,)
        self.action_high = np.asarray(action_high, np.float64)  # (A,)
        self._log_std, self._half = log_std, precision == "bfloat16"
        self._shapes = self._list_shapes()
        count = sum(int(np.prod(shape)) for shape in self._shapes)
        self.theta = nn.Parameter(torch.zeros(count))  # (P,)

    def _list_shapes(self) -> list[tuple[int, ...]]:
        shapes: list[tuple[int, ...]] = []
        channels, extent = self.channels, self.size
        for out, kernel, stride in LAYERS:
            shapes += [(out, channels, kernel, kernel), (out,)]
            channels, extent = out, (extent - kernel) // stride + 1
        shapes += [(FEATURES, channels * extent * extent), (FEATURES,)]
        size = self.action_size
        return [*shapes, (size, FEATURES), (size,), (1, FEATURES), (1,), (size,)]

    @property
    def shape(self) -> dict[str, int | str | list[int]]:
        """What parameters must fit: the images and the actions."""
        return {"size": self.size, "channels": self.channels, "action_size": self.action_size}

    def weights(self, flat: Tensor) -> Parts:
        """Return the layers as views of a flat vector (P,): the parameters or their gradient."""
        sizes = [int(np.prod(shape)) for shape in self._shapes]
        parts = torch.split(flat, sizes)  # its gradient is one concatenation, a slice's is not
        views = [part.view(shape) for part, shape in zip(parts, self._shapes, strict=True)]
        pairs = list(zip(views[:-1:2], views[1:-1:2], strict=True))
        return Parts(pairs[:-2], pairs[-2], pairs[-1], views[-1])

    @property
    def present(self) -> Parts:
        """The layers as views of the parameters, without their history for autograd."""
        return self.weights(self.theta.detach())

    @torch.no_grad()
    def initialize(self, generator: torch.Generator) -> None:
        """Draw orthogonal weights (Saxe et al. 2014); biases are 0."""
        weights = self.weights(self.theta.zero_())
        for weight, _ in weights.layers:
            nn.init.orthogonal_(weight, HIDDEN_GAIN, generator)
        nn.init.orthogonal_(weights.mean[0], MEAN_GAIN, generator)
        nn.init.orthogonal_(weights.value[0], VALUE_GAIN, generator)
        weights.log_std.fill_(self._log_std)

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Map images (B, O) to means (B, A), log deviations (A,), values (B,)."""
        weights = self.weights(self.theta)
        features = self._features(observation, weights)
        value = F.linear(features, *weights.value)
        return F.linear(features, *weights.mean), weights.log_std, value[:, 0]

    def mean(self, observation: Tensor) -> Tensor:
        """Map images (B, O) to means (B, A), without the critic."""
        weights = self.present
        return F.linear(self._features(observation, weights), *weights.mean)

    def _features(self, observation: Tensor, weights: Parts) -> Tensor:
        """Return what both heads see, (B, F)."""
        x = observation.reshape(-1, self.channels, self.size, self.size)
        with torch.autocast(x.device.type, torch.bfloat16, enabled=self._half):
            for (weight, bias), (_, _, stride) in zip(weights.layers[:-1], LAYERS, strict=True):
                x = F.relu(F.conv2d(x, weight, bias, stride))
            x = F.relu(F.linear(x.flatten(1), *weights.layers[-1]))
        return x.to(observation.dtype)

    def actor(self, mean: np.ndarray, std: np.ndarray) -> Actor:
        """Return the deterministic policy of raw observations, on the CPU.

        Args:
            mean: what normalization subtracts from an observation, (O,).
            std: what it divides by, (O,).
        """
        weights = self.weights(self.theta.detach().cpu())
        layers: list[nn.Module] = [nn.Unflatten(-1, (self.channels, self.size, self.size))]
        for (weight, bias), (_, _, stride) in zip(weights.layers[:-1], LAYERS, strict=True):
            layer = nn.Conv2d(weight.shape[1], weight.shape[0], weight.shape[2], stride)
            layers += [_filled(layer, weight, bias), nn.ReLU()]
        layers.append(nn.Flatten(-3))
        for (weight, bias), last in ((weights.layers[-1], False), (weights.mean, True)):
            layers.append(_filled(nn.Linear(weight.shape[1], weight.shape[0]), weight, bias))
            layers += [] if last else [nn.ReLU()]
        return Actor(nn.Sequential(*layers), mean, std, self.action_low, self.action_high)


def _filled(layer: nn.Conv2d | nn.Linear, weight: Tensor, bias: Tensor) -> nn.Module:
    with torch.no_grad():
        layer.weight.copy_(weight)
        if layer.bias is not None:
            layer.bias.copy_(bias)
    return layer
