"""The policy: a small deterministic network on a flat parameter vector, many of them at once.

    options = {"hidden": (64, 64), "activation": "tanh", "output": "tanh", "initial": "normal"}
    policy = MLPPolicy(11, 3, low, high, **options)
    slots = policy.slots(256)
    slots.load(np.arange(256), thetas)              # one parameter vector per row
    action = slots.act(None, observation)           # (256, 3)

A row's action depends on its own parameters and observation alone: not on the other rows, nor on
how many there are, to the last bit. Evolution strategies, their resume and their distribution over
machines rest on it. Each row's product is its own matrix-vector product in numpy, which holds it to
that.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from torch import nn
from torchrl.data import Unbounded
from torchrl.envs import EnvBase, Transform, TransformedEnv

from envs.torch_env import RowsEnv
from sim2real.learning.modules.acting import Acting, Actor
from sim2real.runs.errors import Sim2RealError

Activation = Literal["tanh", "relu"]


class ParameterSlice(NamedTuple):
    """A stretch of the flat parameter vector: theta[start:stop] reshaped to shape."""

    start: int
    stop: int
    shape: tuple[int, int]


class MLPPolicy:
    """A multi-layer perceptron from normalized observations to actions.

    The flat vector holds, layer by layer, the weights (in, out) and the biases (1, out).

    Args:
        observation_size: O, numbers in an observation.
        action_size: A, numbers in an action.
        action_low: the actions' lower limits, (A,), in the actions' units.
        action_high: the actions' upper limits, (A,).
        hidden: widths of the hidden layers; empty is a linear policy.
        activation: the hidden layers' nonlinearity.
        output: "tanh" squashes into the action limits; "linear" leaves clipping to the environment.
        initial: "normal" draws weights from N(0, 2 / fan_in) with zero biases (He et al. 2015);
            "zero" starts a linear policy at 0.

    Raises:
        Sim2RealError: for sizes, names or limits that make no policy.
    """

    cut, is_function = False, True  # see `FlatPolicy`

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        action_low: np.ndarray,
        action_high: np.ndarray,
        *,
        hidden: tuple[int, ...],
        activation: Activation,
        output: Literal["tanh", "linear"],
        initial: Literal["normal", "zero"],
    ) -> None:
        self.observation_size, self.action_size = int(observation_size), int(action_size)
        self.action_low = np.asarray(action_low, np.float64)  # (A,)
        self.action_high = np.asarray(action_high, np.float64)  # (A,)
        self.hidden = tuple(int(width) for width in hidden)
        self.activation: Activation = activation
        self.output, self._initial = output, initial
        self._check()
        sizes = (self.observation_size, *self.hidden, self.action_size)
        self.pieces: list[ParameterSlice] = []
        start = 0
        for inputs, outputs in pairwise(sizes):
            for shape in ((inputs, outputs), (1, outputs)):
                stop = start + shape[0] * shape[1]
                self.pieces.append(ParameterSlice(start, stop, shape))
                start = stop
        self.num_parameters = start

    def _check(self) -> None:
        if min(self.observation_size, self.action_size, *self.hidden, 1) < 1:
            sizes = (self.observation_size, *self.hidden, self.action_size)
            raise Sim2RealError(f"policy: layer sizes {sizes} must all be at least 1")
        allowed = {
            "activation": ("tanh", "relu"),
            "output": ("tanh", "linear"),
            "_initial": ("normal", "zero"),
        }
        for name, choices in allowed.items():
            if getattr(self, name) not in choices:
                value = getattr(self, name)
                raise Sim2RealError(
                    f"policy.{name.strip('_')}={value!r} is not one of {', '.join(choices)}"
                )
        if self._initial == "zero" and self.hidden:
            raise Sim2RealError(
                f"policy.initial=zero with hidden={self.hidden} has a zero gradient everywhere; "
                "use initial=normal, or hidden=[]"
            )
        if self.action_low.shape != (self.action_size,) or self.action_high.shape != (
            self.action_size,
        ):
            raise Sim2RealError(
                f"policy: action limits of shape {self.action_low.shape} and "
                f"{self.action_high.shape} for {self.action_size} actions"
            )
        limits = np.stack([self.action_low, self.action_high])
        if self.output == "tanh" and not np.isfinite(limits).all():
            raise Sim2RealError("policy.output=tanh needs finite action limits; use output=linear")

    @property
    def shape(self) -> dict[str, int | str | list[int]]:
        """The architecture that a parameter vector must fit: sizes and nonlinearities."""
        return {
            "observation_size": self.observation_size,
            "action_size": self.action_size,
            "hidden": list(self.hidden),
            "activation": self.activation,
            "output": self.output,
        }

    @property
    def middle(self) -> np.ndarray:
        """Centre of the action range, (A,)."""
        return (self.action_high + self.action_low) / 2

    @property
    def half(self) -> np.ndarray:
        """Half the width of the action range, (A,)."""
        return (self.action_high - self.action_low) / 2

    def initial(self, rng: np.random.Generator) -> np.ndarray:
        """Draw a first parameter vector, (num_parameters,) float32."""
        theta = np.zeros(self.num_parameters, np.float32)
        if self._initial == "normal":
            for piece in self.pieces[::2]:
                scale = np.sqrt(2 / piece.shape[0])
                theta[piece.start : piece.stop] = scale * rng.standard_normal(
                    piece.stop - piece.start
                )
        return theta

    def slots(self, num_rows: int) -> MLPPolicyBatch:
        """Make room for `num_rows` parameter vectors that act side by side."""
        return MLPPolicyBatch(self, num_rows)

    def module(self, theta: np.ndarray, mean: np.ndarray, std: np.ndarray) -> Actor:
        """Build the same function as a torch module of raw observations.

        Args:
            theta: the parameters, (num_parameters,).
            mean: what normalization subtracts from an observation, (O,).
            std: what it divides by, (O,).
        """
        theta = np.asarray(theta, np.float32)
        if theta.shape != (self.num_parameters,):
            raise Sim2RealError(
                f"policy: {theta.shape} parameters for a network of {self.num_parameters}"
            )
        layers: list[nn.Module] = []
        for weight, bias in zip(self.pieces[::2], self.pieces[1::2], strict=True):
            if layers:
                layers.append(nn.Tanh() if self.activation == "tanh" else nn.ReLU())
            linear = nn.Linear(*weight.shape)
            matrix = theta[weight.start : weight.stop].reshape(weight.shape)
            with torch.no_grad():
                linear.weight.copy_(torch.from_numpy(matrix.T.copy()))
                linear.bias.copy_(torch.from_numpy(theta[bias.start : bias.stop].copy()))
            layers.append(linear)
        squash = "tanh" if self.output == "tanh" else "none"
        network = nn.Sequential(*layers)
        return Actor(network, mean, std, self.action_low, self.action_high, squash)

    def acting(self, theta: np.ndarray, mean: np.ndarray, std: np.ndarray) -> Acting:
        """Return `module` as TorchRL steps with it."""
        return Acting(self.module(theta, mean, std))

    def primers(self) -> list[Transform]:
        """Return nothing: there is no memory."""
        return []


def mlp_policy(
    env: TransformedEnv,
    *,
    hidden: tuple[int, ...],
    activation: Activation,
    output: Literal["tanh", "linear"],
    initial: Literal["normal", "zero"],
) -> MLPPolicy:
    """Make the policy for an environment; see `MLPPolicy`.

    Raises:
        Sim2RealError: sizes and names that make no policy.
    """
    low, high = action_limits(env)
    return MLPPolicy(
        observation_size(env),
        len(low),
        low,
        high,
        hidden=hidden,
        activation=activation,
        output=output,
        initial=initial,
    )


def action_limits(env: EnvBase) -> tuple[np.ndarray, np.ndarray]:
    """Return the actions' limits, (A,) float64 each; those of rows as exactly as they know them.

    Raises:
        Sim2RealError: actions that are not vectors.
    """
    base = env.base_env if isinstance(env, TransformedEnv) else env
    if isinstance(base, RowsEnv):
        return base.rows.action_low, base.rows.action_high
    spec: Any = env.action_spec_unbatched
    if spec.ndim != 1 or not spec.dtype.is_floating_point:
        raise Sim2RealError(
            f"policy: actions are vectors of numbers, but the environment takes {spec.dtype} of "
            f"shape "
            f"{tuple(spec.shape)}"
        )
    if isinstance(spec, Unbounded):
        return np.full(spec.shape, -np.inf), np.full(spec.shape, np.inf)
    low, high = (np.asarray(x.cpu(), np.float64) for x in (spec.space.low, spec.space.high))
    return low, high


def observation_size(env: EnvBase) -> int:
    """Return how many numbers the entry "observation" has; raises Sim2RealError without one."""
    shown: dict[Any, Any] = dict(env.full_observation_spec.items())
    spec = shown.get("observation")
    if spec is None or spec.ndim != len(env.batch_size) + 1:
        raise Sim2RealError(
            "policy: it needs a vector 'observation', which is missing; the environment provides: "
            f"{', '.join(map(str, shown))}"
        )
    return spec.shape[-1]


class MLPPolicyBatch:
    """Per-row weights of many policies, and one forward pass over any of the rows.

    Args:
        policy: the architecture.
        num_rows: R, parameter vectors held.
    """

    def __init__(self, policy: MLPPolicy, num_rows: int) -> None:
        self._policy, self._num_rows = policy, num_rows
        self._arrays = [np.zeros((num_rows, *piece.shape), np.float32) for piece in policy.pieces]
        self._buffers = [
            np.empty((num_rows, 1, piece.shape[1]), np.float32) for piece in policy.pieces[::2]
        ]
        self._selected_ids: np.ndarray | None = None
        self._selected = self._arrays
        self._middle, self._half = policy.middle, policy.half

    def load(self, ids: np.ndarray, thetas: np.ndarray) -> None:
        """Put parameter vectors into rows.

        Args:
            ids: the rows, (n,).
            thetas: their parameters, (n, num_parameters).
        """
        thetas = np.asarray(thetas, np.float32)
        for piece, array in zip(self._policy.pieces, self._arrays, strict=True):
            array[ids] = thetas[:, piece.start : piece.stop].reshape(-1, *piece.shape)
        self._selected_ids = None

    def act(self, ids: np.ndarray | None, observation: np.ndarray) -> np.ndarray:
        """Compute the actions of some rows.

        Args:
            ids: the rows, (n,), sorted; None is all of them.
            observation: their normalized observations, (n, O).

        Returns:
            Actions in the actions' units, (n, A) float64.
        """
        arrays = self._arrays if ids is None else self._select(ids)
        x = observation.astype(np.float32)[:, None]  # (n, 1, O)
        last = len(self._buffers) - 1
        for layer, buffer in enumerate(self._buffers):
            out = buffer[: len(x)]
            np.matmul(x, arrays[2 * layer], out=out)  # (n, 1, width)
            out += arrays[2 * layer + 1]
            if layer < last:
                _activate(out, self._policy.activation)
            x = out
        if self._policy.output == "linear":
            return x[:, 0].astype(np.float64)
        return self._middle + self._half * np.tanh(x[:, 0])

    def _select(self, ids: np.ndarray) -> list[np.ndarray]:
        """Gather the rows' weights, once for as long as the rows and weights stay the same."""
        if len(ids) == self._num_rows:
            return self._arrays
        last = self._selected_ids
        if last is None or len(ids) != len(last) or (ids != last).any():
            self._selected = [array[ids] for array in self._arrays]
            self._selected_ids = ids.copy()
        return self._selected


def _activate(x: np.ndarray, activation: Activation) -> None:
    """Apply the nonlinearity in place."""
    if activation == "tanh":
        np.tanh(x, out=x)
    else:
        np.maximum(x, 0, out=x)
