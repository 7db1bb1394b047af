"""The interface of a population's policy: its parameters are one vector, of which many act.

    slots = policy.slots(256)
    slots.load(np.arange(256), thetas)                # a parameter vector per row
    action = slots.act(None, observation)             # (256, A)

`MLPPolicy` is one by itself, `ActorPolicy` makes one of any tensordict actor. A row's action
depends on nothing but its own parameters, memory and observation, to the last bit.
"""

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from tensordict.nn import TensorDictModuleBase
from torch import nn
from torchrl.envs import Transform


class PolicyBatch(Protocol):
    """Parameter vectors of rows, and what those policies do."""

    def load(self, ids: np.ndarray, thetas: np.ndarray) -> None:
        """Put parameter vectors (n, P) into rows (n,), whose episodes begin."""
        ...

    def act(self, ids: np.ndarray | None, observation: np.ndarray) -> np.ndarray:
        """Return the actions (n, A) of rows ids (n,), or all, from observations (n, O)."""
        ...


class FlatPolicy(Protocol):
    """A deterministic policy with P parameters in one vector.

    Attributes:
        observation_size: O, numbers that it sees.
        num_parameters: P.
        cut: whether its actions are cut at their limits.
    """

    observation_size: int
    num_parameters: int
    cut: bool

    @property
    def is_function(self) -> bool:
        """Whether an action follows from one observation, by `module`."""
        ...

    @property
    def shape(self) -> dict[str, Any]:
        """The architecture that a parameter vector must fit."""
        ...

    def initial(self, rng: np.random.Generator) -> np.ndarray:
        """Return the first parameters, (P,) float32."""
        ...

    def slots(self, num_rows: int) -> PolicyBatch:
        """Make room for parameter vectors that act side by side."""
        ...

    @property
    def primers(self) -> Callable[[], Sequence[Transform]]:
        """A function that makes the transforms that `acting` needs."""
        ...

    def acting(self, theta: np.ndarray, mean: np.ndarray, std: np.ndarray) -> TensorDictModuleBase:
        """Return the policy of parameters (P,) as a tensordict module, shown raw observations.

        Args:
            theta: the parameters.
            mean: what normalization subtracts from an observation, (O,).
            std: what it divides by, (O,).
        """
        ...

    def module(self, theta: np.ndarray, mean: np.ndarray, std: np.ndarray) -> nn.Module:
        """Return the same as a torch module of raw observations, where it `is_function`."""
        ...
