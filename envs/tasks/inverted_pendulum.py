"""InvertedPendulum: the continuous CartPole, a pole on a cart, rewarded for each step upright."""

from envs.physics.arrays import Array
from envs.tasks.base import GymnasiumTask, State


class InvertedPendulum(GymnasiumTask):
    """Gymnasium 1.4 InvertedPendulum-v5: observation (4,), action (1,) in [-3, 3] times 100 N.

    Args:
        max_steps: control steps an episode (40 ms each).
    """

    array_api = True
    asset = "inverted_pendulum.xml"
    frame_skip = 2
    reset_noise = 0.01
    healthy_angle = 0.2  # rad, of the pole

    def observe(self, state: State) -> Array:
        """Return (cart position, pole angle, their velocities), (n, 4)."""
        return self.xp.concat([state.qpos, state.qvel], axis=1)

    def terminated(self, state: State) -> Array:
        """Return whether the pole fell or the state is not finite, (n,)."""
        return ~(self.finite(state) & (self.xp.abs(state.qpos[:, 1]) <= self.healthy_angle))

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return 1 for a step that ends upright and 0 for the one on which the pole falls, (n,)."""
        return self.xp.where(terminated, 0.0, 1.0)
