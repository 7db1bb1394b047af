"""The small tasks as TorchRL environments.

env = ToyEnv(Nav2D, num_envs=64, max_steps=100)
env = TransformedEnv(env, RandomizeParams(NavGoals()))
"""

from collections.abc import Callable
from typing import Any

import torch

from envs.torch_env import RowsEnv
from envs.toys.base import Toy


class ToyEnv(RowsEnv):
    """num_envs episodes of a small task, batch size (num_envs,).

    Args:
        toy: makes the task from num_rows and `settings`.
        num_envs: N.
        device: where tensors go.
        dtype: the dtype of observations, actions and rewards.
        seed: the seed of the episodes.
        settings: the settings of the task, such as max_steps.
    """

    def __init__(
        self,
        toy: Callable[..., Toy],
        num_envs: int = 1,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
        seed: int = 0,
        **settings: Any,
    ) -> None:
        super().__init__(toy(num_rows=num_envs, **settings), device, dtype, seed)
