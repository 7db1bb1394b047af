"""Swimmer: three links in a viscous fluid that are rewarded for swimming forward."""

from envs.physics.arrays import Array
from envs.tasks.base import GymnasiumTask, State


class Swimmer(GymnasiumTask):
    """Gymnasium 1.4 Swimmer-v5: observation (8,), action (2,) torques in [-1, 1] times 150 N·m.

    Args:
        max_steps: control steps an episode (40 ms each).
    """

    array_api = True
    asset = "swimmer.xml"
    frame_skip = 4
    camera = "track"
    reset_noise = 0.1
    control_cost = 1e-4

    def observe(self, state: State) -> Array:
        """Return (angles, velocities) without the position in the plane, (n, 8)."""
        return self.xp.concat([state.qpos[:, 2:], state.qvel], axis=1)

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return forward velocity - control cost, (n,)."""
        return self.velocity(before, after) - self.control_cost * self.effort(action)
