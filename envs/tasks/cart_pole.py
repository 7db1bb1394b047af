"""CartPole: a position drive balances a pole, on a robot of eleven uncertain parameters.

After Dong et al., "EASI" (2024), and the task that its authors released.
"""

from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from envs.effects import make
from envs.effects.base import Effect
from envs.models import load_spec
from envs.noise import uniform
from envs.physics.arrays import Array
from envs.tasks.base import State, Task

MODEL = Path(__file__).parents[1] / "assets" / "cartpole.xml"
KNEE = 0.48  # m/s, from which the drive's force falls
NO_LOAD = 1.25  # times that: the largest speed of the drive, 0.6 m/s


class CartPole(Task):
    """Balance a pole on a cart with position commands.

    Observation (4,): cart position [m] and velocity [m/s], pole angle from upright [rad] and
    velocity [rad/s]. Action (1,): the drive's goal in [-1, 1] times 0.2 m. Reward: 1 - angle² -
    0.01 |cart velocity| - 0.005 |pole velocity|, and -2 on the step that ends the episode: the cart
    beyond 0.18 m, or the pole below the horizontal.

    The authors' engine clamps the cart's velocity at 0.6 m/s. Here the drive's force falls from
    0.48 m/s to nothing there, and nothing keeps the pole from pulling the cart on.

    Args:
        max_steps: control steps an episode (20 ms each).
    """

    array_api = True
    frame_skip = 4
    camera = "front"
    commands = True
    reach = 0.2  # m, of the goal
    edge = 0.18  # m, where the cart must stay within
    lowest = np.pi / 2  # rad, of the pole
    fall = -2.0  # the reward of the last step
    positions, velocities = 0.1, 0.2  # half widths of the uniform starts, in SI units

    def __init__(self, max_steps: int = 200) -> None:
        self.max_steps = max_steps

    def spec(self) -> mujoco.MjSpec:
        """Return the model of assets/cartpole.xml."""
        return load_spec(MODEL)

    def fixed(self) -> Sequence[tuple[Effect, Sequence[float]]]:
        """Return the drive's limit on the speed."""
        return [(make("torque_speed_knee", where="slider", no_load=NO_LOAD), (KNEE,))]

    def initial(self, seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return uniform states around rest: (n, 2) [m, rad], (n, 2) [m/s, rad/s]."""
        qpos, qvel = (2.0 * uniform(seeds, stream, 2) - 1.0 for stream in (0, 1))
        return self.positions * qpos, self.velocities * qvel

    def action_range(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Return -1 and 1, (1,) each."""
        return -np.ones(1), np.ones(1)

    def command(self, state: State, action: Array) -> Array:
        """Return the drive's goals [m], (n, 1)."""
        return self.reach * self.xp.clip(action, -1.0, 1.0)

    def observe(self, state: State) -> Array:
        """Return (cart position and velocity, pole angle and velocity), (n, 4)."""
        return self.xp.stack([state.qpos, state.qvel], axis=2).reshape(len(state.qpos), 4)

    def terminated(self, state: State) -> Array:
        """Return whether the cart is beyond its edge or the pole below the horizontal, (n,)."""
        cart, pole = self.xp.abs(state.qpos).T
        return ~((cart <= self.edge) & (pole <= self.lowest))  # a NaN is not kept

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return the reward for an upright, quiet pole, or -2 for a fall, (n,)."""
        cart, pole = self.xp.abs(after.qvel).T
        paid = 1.0 - after.qpos[:, 1] ** 2 - 0.01 * cart - 0.005 * pole
        return self.xp.where(terminated, self.fall, paid)
