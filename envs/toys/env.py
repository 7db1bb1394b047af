"""The small tasks as TorchRL environments.

env = ToyEnv(partial(Nav2D, max_steps=100), num_envs=64)
env = TransformedEnv(env, RandomizeParams(NavGoals()))
"""

from __future__ import annotations

from collections.abc import Callable

import torch

from envs.torch_env import RowsEnv
from envs.toys.base import Toy


class ToyEnv(RowsEnv):
    """num_envs episodes of a small task, batch size (num_envs,).

    Args:
        toy: makes the task from num_rows.
        num_envs: N.
        device: where tensors go.
        dtype: of observations, actions and rewards.
        seed: of the episodes.
    """

    def __init__(
        self,
        toy: Callable[..., Toy],
        num_envs: int = 1,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
        seed: int = 0,
    ) -> None:
        super().__init__(toy(num_rows=num_envs), device, dtype, seed)
