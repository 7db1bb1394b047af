"""BallBalance: a tray on three legs catches a ball and keeps it in its middle.

After Dong et al., "EASI" (2024), and the task that its authors released.
"""

from pathlib import Path

import mujoco
import numpy as np

from envs.models import load_spec
from envs.noise import uniform
from envs.physics.arrays import Array
from envs.tasks.base import State, Task

MODEL = Path(__file__).parents[1] / "assets" / "ball_balance.xml"
BALL, BALL_SPEED = 13, 12  # where its position begins in qpos, and its velocity in qvel
KNEES, KNEE_SPEEDS = [8, 10, 12], [7, 9, 11]


class BallBalance(Task):
    """Catch a ball that falls from 1 to 2 m, and keep it still 0.5 m above the ground.

    Observation (12,): the knees' angles [rad] and speeds, the ball's position [m] and velocity.
    Action (3,): how fast the knees' goals move, in [-1, 1] times 20 rad/s. Reward: 1 / (1 + d)² /
    (1 + the ball's speed), d² = x² + y² + 2 (z - 0.5)². The ball's centre below 0.3 m ends it.

    Args:
        max_steps: control steps an episode (0.1 s each).
    """

    array_api = True
    frame_skip = 50
    camera = "front"
    commands = True
    speed = 20.0  # rad/s, of the goals
    wanted, lowest = 0.5, 0.3  # m, of the ball's centre
    heights, farthest = (1.0, 2.0), (0.001, 0.5)  # m: where it starts
    inwards, down = 2.0, 2.0  # m/s: the largest horizontal speed of a start, and its vertical one

    def __init__(self, max_steps: int = 500) -> None:
        self.max_steps = max_steps

    def spec(self) -> mujoco.MjSpec:
        """Return the model of assets/ball_balance.xml."""
        return load_spec(MODEL)

    def setup(self, model: mujoco.MjModel) -> None:
        """Read off the limits of the goals, too."""
        super().setup(model)
        self._low, self._high = model.actuator_ctrlrange.T

    def initial(self, seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the tray at rest and a ball that is thrown towards its middle."""
        far, turn, height, fast = uniform(seeds, 0, 4).T
        qpos, qvel = np.tile(self.start, (len(seeds), 1)), np.zeros((len(seeds), self.nv))
        near, most = self.farthest
        way = np.stack([np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)], axis=1)
        qpos[:, BALL : BALL + 2] = (near + (most - near) * far)[:, None] * way
        low, high = self.heights
        qpos[:, BALL + 2] = low + (high - low) * height
        qvel[:, BALL_SPEED : BALL_SPEED + 2] = -(self.inwards * far * fast)[:, None] * way
        qvel[:, BALL_SPEED + 2] = -self.down
        return qpos, qvel

    def action_range(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Return -1 and 1, (3,) each."""
        return -np.ones(model.nu), np.ones(model.nu)

    def command(self, state: State, action: Array) -> Array:
        """Return the knees' goals [rad], (n, 3): those before, moved for a control step."""
        assert state.command is not None
        moved = state.command.goal + self.dt * self.speed * self.xp.clip(action, -1.0, 1.0)
        return self.xp.clip(moved, self._low, self._high)

    def observe(self, state: State) -> Array:
        """Return (knees, their speeds, the ball, its velocity), (n, 12)."""
        ball, speed = _ball(state)
        return self.xp.concat(
            [state.qpos[:, KNEES], state.qvel[:, KNEE_SPEEDS], ball, speed], axis=1
        )

    def terminated(self, state: State) -> Array:
        """Return whether the ball is below the tray, (n,)."""
        return ~(state.qpos[:, BALL + 2] >= self.lowest)

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return the reward for a ball that is near and slow, (n,)."""
        ball, velocity = _ball(after)
        x, y, z = ball.T
        distance = self.xp.sqrt(x**2 + y**2 + 2.0 * (z - self.wanted) ** 2)
        return 1 / (1 + distance) ** 2 / (1 + self.xp.linalg.vector_norm(velocity, axis=1))


def _ball(state: State) -> tuple[Array, Array]:
    """Return the ball's position [m] and velocity [m/s], (n, 3) each."""
    return state.qpos[:, BALL : BALL + 3], state.qvel[:, BALL_SPEED : BALL_SPEED + 3]
