"""Policies of a population where the rows' arrays are: one batched product a layer.

    slots = Slots(policy, rows)                     # rows of `physics=warp`
    slots.load(np.arange(256), thetas)              # a parameter vector per row
    action = slots.act(None, observation)           # (256, A), a tensor

The numbers are float32 as in `MLPPolicy.slots`; that a row's action depends on no other row holds
to rounding.
"""

from typing import Any

import numpy as np

from envs.physics.arrays import Array
from envs.rows import Rows, arrays_of
from sim2real.learning.modules.mlp_policy import MLPPolicy
from sim2real.runs.errors import Sim2RealError


class Slots:
    """Parameter vectors of rows on a device, and what those policies do.

    Args:
        policy: an `MLPPolicy`.
        rows: N rows whose arrays are tensors.

    Raises:
        Sim2RealError: another policy.
    """

    def __init__(self, policy: Any, rows: Rows) -> None:
        if not isinstance(policy, MLPPolicy):
            raise Sim2RealError(
                f"physics=warp runs only populations of perceptrons, not of a "
                f"{type(policy).__name__}; use policy=mlp or policy=linear, or physics=batch"
            )
        self._policy, self._arrays = policy, arrays_of(rows)
        self._layers = [self._arrays.zeros((rows.num_rows, *one.shape)) for one in policy.pieces]
        self._middle, self._half = (self._arrays.own(x) for x in (policy.middle, policy.half))

    def load(self, ids: np.ndarray, thetas: np.ndarray) -> None:
        """Put parameter vectors (n, P) into rows (n,), whose episodes begin."""
        rows, own = self._arrays.rows(ids), self._arrays.own(np.asarray(thetas, np.float32))
        for piece, layer in zip(self._policy.pieces, self._layers, strict=True):
            layer[rows] = own[:, piece.start : piece.stop].reshape(-1, *piece.shape)

    def act(self, ids: np.ndarray | None, observation: Array) -> Array:
        """Return the actions (N, A) of all rows, from observations (N, O)."""
        xp, x = self._arrays.xp, observation[:, None]  # (N, 1, O)
        last = len(self._layers) // 2 - 1
        for layer in range(last + 1):
            x = x @ self._layers[2 * layer] + self._layers[2 * layer + 1]
            if layer < last:
                x = xp.tanh(x) if self._policy.activation == "tanh" else xp.clip(x, 0.0, None)
        if self._policy.output == "linear":
            return x[:, 0]
        return self._middle + self._half * xp.tanh(x[:, 0])
