"""HalfCheetah: a planar runner that is rewarded for speed and never falls."""

from envs.physics.arrays import Array
from envs.tasks.base import GymnasiumTask, State


class HalfCheetah(GymnasiumTask):
    """Gymnasium 1.4 HalfCheetah-v5: observation (17,), action (6,) in [-1, 1] times 30 to 120 N·m.

    Args:
        max_steps: control steps an episode (50 ms each).
    """

    array_api = True
    asset = "half_cheetah.xml"
    frame_skip = 5
    camera = "track"
    reset_noise = 0.1
    velocity_noise = "normal"
    control_cost = 0.1

    def observe(self, state: State) -> Array:
        """Return (height, angles, velocities) without the horizontal position, (n, 17)."""
        return self.xp.concat([state.qpos[:, 1:], state.qvel], axis=1)

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return forward velocity - control cost, (n,)."""
        return self.velocity(before, after) - self.control_cost * self.effort(action)
