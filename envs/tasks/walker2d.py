"""Walker2d: two legs that are rewarded for walking forward and staying upright."""

from envs.physics.arrays import Array
from envs.tasks.base import GymnasiumTask, State


class Walker2d(GymnasiumTask):
    """Gymnasium 1.4 Walker2d-v5: observation (17,), action (6,) torques in [-1, 1] times 100 N·m.

    Args:
        max_steps: control steps an episode (8 ms each).
    """

    array_api = True
    asset = "walker2d_v5.xml"
    frame_skip = 4
    camera = "track"
    reset_noise = 5e-3
    healthy_height = (0.8, 2.0)  # m, of the torso
    healthy_angle = 1.0  # rad, of the torso
    velocity_clip = 10.0
    control_cost = 1e-3

    def observe(self, state: State) -> Array:
        """Return (height, angles, clipped velocities) without the horizontal position, (n, 17)."""
        qvel = self.xp.clip(state.qvel, -self.velocity_clip, self.velocity_clip)
        return self.xp.concat([state.qpos[:, 1:], qvel], axis=1)

    def terminated(self, state: State) -> Array:
        """Return whether the walker fell or jumped out of the healthy range, (n,)."""
        height, angle = state.qpos[:, 1], state.qpos[:, 2]
        low, high = self.healthy_height
        return ~((low < height) & (height < high) & (self.xp.abs(angle) < self.healthy_angle))

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return forward velocity + 1 while healthy - control cost, (n,)."""
        return self.velocity(before, after) + ~terminated - self.control_cost * self.effort(action)
