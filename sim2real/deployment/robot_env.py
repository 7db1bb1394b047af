"""A robot as the environment of a policy, and one episode in it.

env = on_robot(trained, Quad8(), backend, folder)   # HardwareEnv with the policy's transforms
robot_of(env).arm()
value, _ = play(env, trained.acting(env), seed=0)   # the return
env.close()
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torchrl.envs import TransformedEnv
from torchrl.envs.utils import step_mdp

from envs.tasks.servo import ServoTask
from hardware.backends import Backend
from hardware.env import HardwareEnv
from hardware.rows import RobotRows
from sim2real.learning.adapt import EpisodeTrajectory
from sim2real.learning.modules.randomness import TorchRandomStream, drawn
from sim2real.learning.trained import TrainedPolicy


def on_robot(
    trained: TrainedPolicy, task: ServoTask, backend: Backend, folder: Path | None = None
) -> TransformedEnv:
    """Return a robot as the environment of a policy; nothing is opened and nothing moves.

    Args:
        trained: the policy, whose transforms it gets, frozen.
        task: of this robot.
        backend: the robot.
        folder: where each episode's log goes; None writes none.

    Raises:
        RobotError: the task is another robot's, or needs a sensor that there is not.
    """
    return trained.over(partial(HardwareEnv, task, backend, folder))


def robot_of(env: TransformedEnv) -> RobotRows:
    """Return the robot under an environment of `on_robot`."""
    base: Any = env.base_env
    return base.robot


@torch.no_grad()
def play(
    env: TransformedEnv, actor: TensorDictModuleBase, seed: int, explores: bool = False
) -> tuple[float, EpisodeTrajectory | None]:
    """Run one episode of one robot, real or simulated.

    Args:
        env: its environment, of one row; the last step's rewards are those of its base.
        actor: the policy, see `TrainedPolicy.acting`.
        seed: the seed of the start, and of actions that are drawn.
        explores: whether actions are drawn.

    Returns:
        The return, summed in float64, and the steps of an episode that explores.
    """
    base: Any = env.base_env
    steps, paid, total = list[TensorDictBase](), list[float](), 0.0
    with drawn(TorchRandomStream(seed % 2**63, "cpu") if explores else None):
        now = env.reset(seeds=np.array([seed], np.uint64))
        while True:
            step = env.step(actor(now))
            paid.append(float(base.rewards[0]))
            total += paid[-1]
            if explores:
                steps.append(step)
            if step.get(("next", "done")).any():
                return total, to_trajectory(steps, paid) if explores else None
            now = step_mdp(step)


def to_trajectory(steps: Sequence[TensorDictBase], paid: Sequence[float]) -> EpisodeTrajectory:
    """Return an episode of one row as the trajectory that an adaptation receives."""

    def numbers(step: TensorDictBase, name: str) -> np.ndarray:
        return step.get(name)[0].numpy().astype(np.float32)

    seen, acted = ([numbers(step, name) for step in steps] for name in ("observation", "action"))
    last = steps[-1].get("next")
    end = None if last.get("terminated").any() else numbers(last, "observation")
    return EpisodeTrajectory(np.stack(seen), np.stack(acted), np.array(paid), end)
