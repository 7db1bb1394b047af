"""The clipped loss of PPO for perceptrons, and its gradient without autograd.

    gradient = ClipGradient(read_dense(actor), read_dense(critic))
    losses = gradient(samples, settings)              # values, what is logged, and the gradient

`FastClipPPOLoss` puts TorchRL's interface around it; the equations are in its docstring. All of it
is NumPy on the memory of torch's tensors: in a minibatch of 64 a call costs more than its work.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from tensordict.nn import AddStateIndependentNormalScale

from sim2real.learning.modules.arrays import Array, ArrayLayers, ArrayMLP
from sim2real.learning.modules.dense import Dense, flatten

LOG_2PI = math.log(2 * math.pi)
DISTANCES: dict[str, Callable[[Array], Array]] = {  # of a value and its target, by the error
    "l2": np.square,
    "l1": np.abs,
    "smooth_l1": lambda error: np.where(abs(error) < 1, 0.5 * error * error, abs(error) - 0.5),
}
SLOPES: dict[str, Callable[[Array], Array]] = {  # of the distances
    "l2": lambda error: 2 * error,
    "l1": np.sign,
    "smooth_l1": lambda error: np.minimum(np.maximum(error, -1), 1),
}


class Samples(NamedTuple):
    """B samples as the loss needs them."""

    actor_input: Array  # (B, O)
    critic_input: Array  # (B, O)
    action: Array  # (B, A)
    log_prob: Array  # (B,), under the policy that acted
    advantage: Array  # (B,), as the loss sees it
    target: Array  # (B,), of the value
    old_value: Array | None  # (B,), that the value is clipped around
    shape: tuple[int, ...]  # of the tensordict that they were: (B,), or several dimensions


class Settings(NamedTuple):
    """Weights and limits of the losses."""

    limits: tuple[float, float]  # least and largest ratio
    critic_coeff: float  # weight of the critic's loss
    entropy_coeff: float  # weight of the entropy
    distance: str  # of values and targets: a key of DISTANCES
    clip_value: float | None  # how far a value may leave the old one
    explained_variance: bool  # whether it is logged


class Losses(NamedTuple):
    """The losses of samples, and their gradient."""

    values: tuple[Any, Any, Any]  # objective, critic, entropy: numbers
    logged: dict[str, Any]  # numbers, or one for each row of samples of several dimensions
    gradient: Array  # (P,): of the objective for the actor, of the critic's loss for the critic
    entropy: Array  # (A,): of the entropy's loss by the scale's parameters


class ClipGradient:
    """The losses of an actor and a critic on the CPU, and their gradients.

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
        self._bodies = ArrayMLP(actor.activation), ArrayMLP(critic.activation)

    def _renew(self) -> None:
        """Follow parameters that were changed outside."""
        if not self.flat.renew():
            return
        vector = self.flat.vector.numpy()
        self._slope = np.zeros_like(vector)
        self._actor, self._log_scale, self._critic = self._views(vector)
        self._actor_slope, self._scale_slope, self._critic_slope = self._views(self._slope)

    def _views(self, vector: Array) -> tuple[ArrayLayers, Array, ArrayLayers]:
        """Return the actor's layers, the scale's logarithms and the critic's layers."""
        shapes = [p.shape for p in self.flat.parameters]
        ends = np.cumsum([shape.numel() for shape in shapes])[:-1]
        parts = [x.reshape(s) for x, s in zip(np.split(vector, ends), shapes, strict=True)]
        head = len(self.networks[0].parameters) - 1
        return ArrayMLP.layers(parts[:head]), parts[head], ArrayMLP.layers(parts[head + 1 :])

    def __call__(self, samples: Samples, settings: Settings) -> Losses:
        """Return the losses of samples and their gradients at the present parameters."""
        self._renew()
        objective, entropy, entropy_slope, acting = self._act(samples, settings)
        critic, judging = self._judge(samples, settings)
        values = objective, critic, entropy
        return Losses(values, acting | judging, self._slope.copy(), entropy_slope)

    def _act(
        self, samples: Samples, settings: Settings
    ) -> tuple[float, float, Array, dict[str, Any]]:
        """Return objective, loss of the entropy, its gradient by the scale, and what is logged."""
        count, actions = samples.action.shape
        raw = np.exp(self._log_scale)
        scale = np.maximum(raw, self._floor)
        free = raw >= self._floor  # elsewhere the scale is held at its floor
        outputs = self._bodies[0].forward(self._actor, samples.actor_input)
        scaled = (outputs[-1] - samples.action) / scale  # (B, A)
        squared = scaled * scaled
        constant = float(np.log(scale).sum()) + 0.5 * actions * LOG_2PI
        log_ratio = np.add.reduce(squared, 1) * -0.5 - constant - samples.log_prob
        ratio = np.exp(log_ratio)
        inside = np.minimum(np.maximum(ratio, settings.limits[0]), settings.limits[1])
        gain = ratio * samples.advantage
        least = np.minimum(gain, inside * samples.advantage)
        # beyond the limit on the side that the advantage pulls to, the objective is flat
        step = (np.where(least < gain, 0, gain) / count)[:, None]  # (B, 1)
        np.add.reduce((1 - squared) * step, 0, out=self._scale_slope)
        self._scale_slope *= free
        to_mean = scaled * step / scale
        self._bodies[0].backward(self._actor, outputs, to_mean, self._actor_slope)
        entropy = constant + 0.5 * actions
        weight = -settings.entropy_coeff
        logged = _ratios(ratio, inside, log_ratio, samples.shape) | {"entropy": entropy}
        return -_mean(least), weight * entropy, weight * free, logged

    def _judge(self, samples: Samples, settings: Settings) -> tuple[float, dict[str, Any]]:
        """Return the critic's loss and what is logged."""
        outputs = self._bodies[1].forward(self._critic, samples.critic_input)
        value = outputs[-1][:, 0]
        error = value - samples.target
        cost, slope = DISTANCES[settings.distance](error), SLOPES[settings.distance](error)
        logged: dict[str, Any] = {}
        if settings.clip_value is not None:
            cost, slope, logged = _clipped(samples, settings, value, cost, slope)
        slope *= settings.critic_coeff / len(value)
        self._bodies[1].backward(self._critic, outputs, slope[:, None], self._critic_slope)
        if settings.explained_variance:
            along = [x.reshape(*samples.shape, 1) for x in (error, samples.target)]
            left, total = (x.var(axis=0) for x in along)
            logged["explained_variance"] = 1 - left / (total + np.finfo(total.dtype).eps)
        return _mean(cost) * settings.critic_coeff, logged


def _mean(x: Array) -> float:
    """Return the mean of numbers (B,); NumPy's own takes three times as long."""
    return float(np.add.reduce(x)) / len(x)


def _ratios(
    ratio: Array, inside: Array, log_ratio: Array, shape: tuple[int, ...]
) -> dict[str, Any]:
    """Return the metrics of the ratios (B,) of samples of a shape."""
    mean, squared = _mean(ratio), ratio * ratio
    if len(shape) > 1:  # along the first dimension
        sums = ratio.reshape(shape).sum(0), squared.reshape(shape).sum(0)
        effective: Any = sums[0] ** 2 / sums[1] / shape[0]
    else:
        effective = mean**2 / _mean(squared)
    return {
        "clip_fraction": np.count_nonzero(inside != ratio) / len(ratio),
        "kl_approx": -_mean(log_ratio),
        "ESS": effective,
        "max_ratio": float(np.maximum.reduce(ratio)),
        "mean_ratio": mean,
    }


def _clipped(
    samples: Samples, settings: Settings, value: Array, cost: Array, slope: Array
) -> tuple[Array, Array, dict[str, Any]]:
    """Return the larger of the costs of the value and of the value near the old one."""
    assert samples.old_value is not None and settings.clip_value is not None
    moved = value - samples.old_value
    limited = np.clip(moved, -settings.clip_value, settings.clip_value)
    near = samples.old_value + limited - samples.target  # its error
    near_cost = DISTANCES[settings.distance](near)
    outside = limited != moved
    near_slope = np.where(outside, 0, SLOPES[settings.distance](near))
    slope = np.where(near_cost > cost, near_slope, slope)
    logged = {"value_clip_fraction": np.count_nonzero(outside) / len(value)}
    return np.maximum(cost, near_cost), slope, logged
