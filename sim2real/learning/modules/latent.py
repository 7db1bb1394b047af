"""A policy conditioned on a few latent numbers z in addition to its observation.

    policy = LatentPolicy(11, 3, low, high, latent=2, hidden=(32,), ...)    # as MLPPolicy
    theta[-policy.latent :]                                                 # z

The flat vector holds the perceptron's parameters, the weights from z to its first layer, and last z
itself. Training moves all of them; `LatentSearch` adapts z alone: few dimensions, which the weights
turn into ways to act (Yu et al. 2020, "Learning fast adaptation with meta strategy optimization").
"""

from typing import Any

import numpy as np
from torchrl.envs import TransformedEnv

from sim2real.learning.modules.acting import Actor
from sim2real.learning.modules.mlp_policy import (
    MLPPolicy,
    MLPPolicyBatch,
    action_limits,
    observation_size,
)
from sim2real.runs.errors import Sim2RealError


class LatentPolicy(MLPPolicy):
    """A multi-layer perceptron of an observation and of latent numbers among its own parameters.

    Args:
        observation_size: O, numbers in an observation.
        action_size: A, numbers in an action.
        action_low: the actions' lower limits, (A,), in the actions' units.
        action_high: the actions' upper limits, (A,).
        latent: how many latent numbers there are.
        options: hidden, activation, output and initial, as `MLPPolicy` takes them.

    Raises:
        Sim2RealError: no latent number, or sizes, names or limits that make no policy.
    """

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        action_low: np.ndarray,
        action_high: np.ndarray,
        *,
        latent: int,
        **options: Any,
    ) -> None:
        if latent < 1:
            raise Sim2RealError(f"policy.latent={latent} must be at least 1")
        self._sizes = (observation_size, action_size, action_low, action_high)
        super().__init__(*self._sizes, **options)
        self.latent, self._network = latent, MLPPolicy(*self._sizes, **options)
        self._width = self.pieces[0].shape[1]
        self.num_parameters = self._network.num_parameters + latent * (self._width + 1)

    @property
    def shape(self) -> dict[str, Any]:
        """The architecture that a parameter vector must fit: sizes and nonlinearities."""
        return {**super().shape, "latent": self.latent}

    def initial(self, rng: np.random.Generator) -> np.ndarray:
        """Draw a first parameter vector, (num_parameters,) float32, whose z is 0."""
        weights = rng.standard_normal(self.latent * self._width) / np.sqrt(self.latent)
        parts = [self._network.initial(rng), weights, np.zeros(self.latent)]
        return np.concatenate(parts).astype(np.float32)

    def plain(self, thetas: np.ndarray) -> np.ndarray:
        """Return the perceptrons that act so: z's share goes to the first biases.

        Args:
            thetas: parameters, (n, num_parameters).

        Returns:
            Those of an `MLPPolicy`, (n, P) float32.
        """
        size, end = self._network.num_parameters, thetas.shape[1] - self.latent
        found = np.array(thetas[:, :size], np.float32)
        weights = thetas[:, size:end].reshape(-1, self.latent, self._width)
        bias = self.pieces[1]
        for k in range(self.latent):  # number by number, so that rows do not depend on one another
            found[:, bias.start : bias.stop] += thetas[:, end + k, None] * weights[:, k]
        return found

    def slots(self, num_rows: int) -> MLPPolicyBatch:
        """Make room for `num_rows` parameter vectors that act side by side."""
        return _LatentSlots(self, num_rows)

    def module(self, theta: np.ndarray, mean: np.ndarray, std: np.ndarray) -> Actor:
        """Build the same function as a torch module of raw observations; see `MLPPolicy`."""
        plain = self.plain(np.asarray(theta, np.float32)[None])[0]
        return self._network.module(plain, mean, std)


class _LatentSlots(MLPPolicyBatch):
    def __init__(self, policy: LatentPolicy, num_rows: int) -> None:
        super().__init__(policy, num_rows)
        self._plain = policy.plain

    def load(self, ids: np.ndarray, thetas: np.ndarray) -> None:
        super().load(ids, self._plain(np.asarray(thetas, np.float32)))


def latent_policy(env: TransformedEnv, *, latent: int, **options: Any) -> LatentPolicy:
    """Make the policy for an environment; see `LatentPolicy`.

    Raises:
        Sim2RealError: sizes and names that make no policy.
    """
    low, high = action_limits(env)
    return LatentPolicy(observation_size(env), len(low), low, high, latent=latent, **options)
