"""MuJoCo tasks as TorchRL environments.

env = MujocoEnv(Hopper(), num_envs=256, effects=tasks.effects)
env = TransformedEnv(env, RandomizeParams(tasks))
collector = Collector(env, policy, frames_per_batch=8192, total_frames=1_000_000)
"""

from collections.abc import Sequence

import torch

from envs.effects.base import Effect
from envs.physics import Engine
from envs.plant import Fixed
from envs.randomization import Tasks
from envs.simulation import Simulation
from envs.tasks.base import Task
from envs.torch_env import RowsEnv


class MujocoEnv(RowsEnv):
    """num_envs simulations of a task, batch size (num_envs,), each with its own parameters.

    Args:
        task: what is simulated.
        num_envs: N.
        effects: what may differ per row; the values travel under ("params", name).
        threads: CPU threads of the physics; 0 for all cores.
        device: where tensors go.
        dtype: the dtype of observations, actions and rewards.
        seed: the seed of the episodes.
        tasks: draws each episode's parameters (see `RowsEnv`).
        fixed: effects that every row has, with their values, as `load_effects` returns them.
        cut: whether actions are cut at their limits (see `RowsEnv`).
        physics: what steps the rows: `batch`, on the CPU's threads, or `warp`, where the tensors
            are (see `envs.physics`). With `warp` nothing but which rows ended goes to the host.

    Raises:
        EffectError: an effect that the robot or the engine cannot have.
        TaskError: an engine that is not there, or that cannot step the task.
    """

    def __init__(
        self,
        task: Task,
        num_envs: int = 1,
        effects: Sequence[Effect] = (),
        threads: int = 0,
        device: torch.device | str = "cpu",
        dtype: torch.dtype = torch.float32,
        seed: int = 0,
        tasks: Tasks | None = None,
        fixed: Sequence[Fixed] = (),
        cut: bool = True,
        physics: Engine = "batch",
    ) -> None:
        simulation = Simulation(task, num_envs, effects, threads, fixed, physics, device)
        super().__init__(simulation, device, dtype, seed, tasks, cut)

    @property
    def simulation(self) -> Simulation:
        """The simulation under the environment."""
        return self.rows  # type: ignore[return-value]
