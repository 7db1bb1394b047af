"""What else steps Hopper: Gymnasium, EnvPool and TorchRL's own wrappers, each as its manual says.

None of them randomizes physics here: it is left out in their favour.
"""

from typing import Any

import gymnasium
import numpy as np
import torch
from torchrl.envs import GymEnv, ParallelEnv

from benchmarks.load import process_tree
from benchmarks.rows.base import Row
from benchmarks.rows.batched import Actor
from benchmarks.world import THREADS, Gait, controller

TASK = "Hopper-v5"


class GymnasiumTorch(Row):
    """One environment, one policy call a step."""

    name = "gymnasium_torch"
    memory = "gymnasium"
    setup = "1 environment, 1 thread"

    def __init__(self, steps: int, gait: Gait) -> None:
        self._steps = steps
        self._gait: Gait = gait

    def build(self) -> None:
        """Make the environment."""
        self._env, self._network = gymnasium.make(TASK), controller(self._gait).network()
        self._observation, _ = self._env.reset(seed=0)

    @torch.no_grad()
    def work(self) -> tuple[float, int]:
        """Step on from where the last run stopped."""
        observation, episodes = self._observation, 0
        for _ in range(self._steps):
            action = self._network(torch.from_numpy(observation).float()).numpy()
            observation, _, terminated, truncated, _ = self._env.step(action)
            if terminated or truncated:
                observation, _ = self._env.reset()
                episodes += 1
        self._observation = observation
        return self._steps, episodes

    def close(self) -> None:
        """Close the environment."""
        self._env.close()


class Vectorized(Row):
    """A vector environment of Gymnasium's interface that resets by itself."""

    memory = "gymnasium"

    def __init__(self, name: str, simulations: int, steps: int, gait: Gait, setup: str) -> None:
        self.name, self.simulations, self.setup = name, simulations, setup
        self._steps = steps
        self._gait: Gait = gait

    def make(self) -> Any:
        """Return Gymnasium's in this process: the faster of its two on machines with few cores."""
        return gymnasium.make_vec(TASK, self.simulations, vectorization_mode="sync")

    def build(self) -> None:
        """Make the environment, and leave the common start behind."""
        self._env, self._network = self.make(), controller(self._gait).network()
        self._observation, _ = self._env.reset()
        self._play(60)

    def work(self) -> tuple[float, int]:
        """Step on from where the last run stopped."""
        return self._steps * self.simulations, self._play(self._steps)

    @torch.no_grad()
    def _play(self, steps: int) -> int:
        observation, episodes = self._observation, 0
        for _ in range(steps):
            action = self._network(torch.from_numpy(observation).float()).numpy().astype(np.float64)
            observation, _, terminated, truncated, _ = self._env.step(action)
            episodes += int((terminated | truncated).sum())
        self._observation = observation
        return episodes

    def close(self) -> None:
        """Close the environments."""
        self._env.close()


class EnvPool(Vectorized):
    """EnvPool, synchronous."""

    needs = "envpool"
    memory = "envpool"

    def make(self) -> Any:
        """Return EnvPool's environment."""
        import envpool  # an optional package

        return envpool.make(
            TASK, env_type="gymnasium", num_envs=self.simulations, num_threads=THREADS, seed=0
        )


class TorchRLParallel(Row):
    """TorchRL's `ParallelEnv` over worker processes."""

    name = "torchrl_parallel"
    simulations = THREADS
    setup = f"ParallelEnv, {THREADS} worker processes"

    def __init__(self, steps: int, gait: Gait) -> None:
        self._steps = steps
        self._gait: Gait = gait

    def build(self) -> None:
        """Start the workers."""
        before = process_tree()
        self._env = ParallelEnv(THREADS, _gym_env, mp_start_method="spawn")
        self._actor = Actor(self._gait)
        with torch.no_grad():
            self._tensordict = self._env.reset()
            self._play(20)
        self._pids = [one.pid for one in process_tree() if one not in before]

    @torch.no_grad()
    def work(self) -> tuple[float, int]:
        """Step on from where the last run stopped."""
        return self._steps * THREADS, self._play(self._steps)

    def _play(self, steps: int) -> int:
        ended = []
        for _ in range(steps):
            done, self._tensordict = self._env.step_and_maybe_reset(self._actor(self._tensordict))
            ended.append(done["next", "done"].sum())
        return int(sum(ended))

    def pids(self) -> list[int]:
        """Return the workers."""
        return self._pids

    def close(self) -> None:
        """End the workers."""
        self._env.close()


def _gym_env() -> GymEnv:
    return GymEnv(TASK)
