"""HalfCheetah: a planar runner that is rewarded for speed and never falls."""

from __future__ import annotations

import mujoco
import numpy as np

from envs.tasks.base import State, Task, effort, forward_velocity, gymnasium_model


class HalfCheetah(Task):
    """Gymnasium 1.4 HalfCheetah-v5: observation (17,), action (6,) in [-1, 1] times 30 to 120 N·m.

    Args:
        max_steps: control steps an episode (50 ms each).
    """

    frame_skip = 5
    camera = "track"
    reset_noise = 0.1
    velocity_noise = "normal"
    control_cost = 0.1

    def __init__(self, max_steps: int = 1000) -> None:
        self.max_steps = max_steps

    def spec(self) -> mujoco.MjSpec:
        """Return Gymnasium's half_cheetah.xml."""
        return gymnasium_model("half_cheetah.xml")

    def observe(self, state: State) -> np.ndarray:
        """Return (height, angles, velocities) without the horizontal position, (n, 17)."""
        return np.concatenate([state.qpos[:, 1:], state.qvel], axis=1)

    def reward(
        self, before: State, after: State, action: np.ndarray, terminated: np.ndarray
    ) -> np.ndarray:
        """Return forward velocity - control cost, (n,)."""
        velocity = forward_velocity(before.qpos, after.qpos, self.dt)
        return velocity - self.control_cost * effort(action)


class HalfCheetahDirection(HalfCheetah):
    """A HalfCheetah that is told by its reward alone which way to run (Finn et al. 2017).

    The goal is 1 for forward and -1 for backward; reward: goal * velocity - 0.05 |action|^2.
    """

    control_cost = 0.05
    has_goal = True

    def reward(
        self, before: State, after: State, action: np.ndarray, terminated: np.ndarray
    ) -> np.ndarray:
        """Return velocity towards the goal - control cost, (n,)."""
        velocity = forward_velocity(before.qpos, after.qpos, self.dt)
        assert after.goal is not None
        return after.goal * velocity - self.control_cost * effort(action)


class HalfCheetahVelocity(HalfCheetah):
    """A HalfCheetah that is told by its reward alone how fast to run (Finn et al. 2017).

    The goal is a velocity [m/s]; reward: -|velocity - goal| - 0.05 |action|^2.
    """

    control_cost = 0.05
    has_goal = True

    def reward(
        self, before: State, after: State, action: np.ndarray, terminated: np.ndarray
    ) -> np.ndarray:
        """Return - distance from the velocity asked for - control cost, (n,)."""
        velocity = forward_velocity(before.qpos, after.qpos, self.dt)
        assert after.goal is not None
        return -np.abs(velocity - after.goal) - self.control_cost * effort(action)
