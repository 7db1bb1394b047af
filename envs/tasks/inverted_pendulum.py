"""InvertedPendulum: the continuous CartPole, a pole on a cart, rewarded for each step upright."""

from __future__ import annotations

import mujoco
import numpy as np

from envs.tasks.base import State, Task, gymnasium_model


class InvertedPendulum(Task):
    """Gymnasium 1.4 InvertedPendulum-v5: observation (4,), action (1,) in [-3, 3] times 100 N.

    Args:
        max_steps: control steps an episode (40 ms each).
    """

    frame_skip = 2
    reset_noise = 0.01
    healthy_angle = 0.2  # rad, of the pole

    def __init__(self, max_steps: int = 1000) -> None:
        self.max_steps = max_steps

    def spec(self) -> mujoco.MjSpec:
        """Return Gymnasium's inverted_pendulum.xml."""
        return gymnasium_model("inverted_pendulum.xml")

    def observe(self, state: State) -> np.ndarray:
        """Return (cart position, pole angle, their velocities), (n, 4)."""
        return np.concatenate([state.qpos, state.qvel], axis=1)

    def terminated(self, state: State) -> np.ndarray:
        """Return whether the pole fell or the state is not finite, (n,)."""
        finite = np.isfinite(state.qpos).all(1) & np.isfinite(state.qvel).all(1)
        return ~(finite & (np.abs(state.qpos[:, 1]) <= self.healthy_angle))

    def reward(
        self, before: State, after: State, action: np.ndarray, terminated: np.ndarray
    ) -> np.ndarray:
        """Return 1 for a step that ends upright and 0 for the one on which the pole falls, (n,)."""
        return (~terminated).astype(np.float64)
