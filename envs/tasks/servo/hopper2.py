"""Hopper2: a leg of two servos on a boom that is rewarded for hopping forward."""

from collections.abc import Mapping
from copy import copy
from typing import Any, Literal, Self, get_args

import mujoco
import numpy as np

from envs.errors import TaskError, refuse_unknown
from envs.physics.arrays import Array
from envs.tasks.base import State
from envs.tasks.servo.base import Fidelity, ServoTask, clock, commanded
from envs.tasks.servo.legs import Gait, joints

Goal = Literal["distance", "height"]


class Hopper2(ServoTask):
    """Hop along a boom that keeps the body level.

    Observation (8,): the angles of hip and knee [rad], their speeds [rad/s], sine and cosine of the
    rhythm's phase, and the last action. Action (2,): what is added to the leg's swing and to its
    extension [rad], each within 0.6. Reward of `distance`: min(v, 1.5 m/s) dt - 0.005 sum |torque
    speed| dt, with v the body's speed; of `height`: how far the body is above where a straight leg
    would still touch the ground, times 10 dt, less the same price. It ends when the body is down.

    Args:
        fidelity: "ideal" (stiff position actuators) or "servo" (motor and firmware).
        goal: "distance" or "height".
        robot: the robot's file: a name in conf/robot, a path, or what such a file holds.
        seconds: length of an episode [s].

    Raises:
        TaskError: another goal.
    """

    asset = "hopper2.xml"
    gait = Gait(frequency=3.5, swing=0.0, extension=0.1)
    home_bend = 0.5  # rad, of the keyframe's leg
    reach = 0.6  # rad, of the actions
    fastest = 1.5  # m/s, the largest speed that is rewarded
    energy_cost = 0.005  # 1/W of the reward a second
    straight = 0.128  # m, height of the body on a straight leg
    height_reward = 10.0  # a second and metre
    lowest = 0.045  # m, height of the body

    def __init__(
        self,
        fidelity: Fidelity = "servo",
        goal: Goal = "distance",
        robot: str | Mapping[str, Any] = "hopper2",
        seconds: float = 3.0,
    ) -> None:
        refuse_unknown("goal", goal, get_args(Goal), TaskError)
        self.goal = goal
        super().__init__(fidelity, robot, seconds)

    def setup(self, model: mujoco.MjModel) -> None:
        """Read off the body's height at home too."""
        super().setup(model)
        self.floor = float(model.body("body").pos[2])  # m, what boom_z counts from

    def action_range(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and largest offsets [rad], (2,) each."""
        return np.full(2, -self.reach), np.full(2, self.reach)

    def target_angles(self, state: State, action: Array) -> Array:
        """Return the rhythm with the action's swing and extension added [rad], (n, 2)."""
        swing, extension = self.gait.pattern(clock(state, self.gait.frequency)[:, None], self.xp)
        legs = swing + action[:, :1], extension + action[:, 1:]
        return joints(*legs, self.home_bend, self.xp)

    def observe(self, state: State) -> Array:
        """Return (angles, speeds, sine and cosine of the phase, last action), (n, 8)."""
        xp, phase = self.xp, clock(state, self.gait.frequency)
        rhythm = xp.stack([xp.sin(phase), xp.cos(phase)], axis=1)
        seen = [state.qpos[:, self.q], state.qvel[:, self.v], rhythm, commanded(state).action]
        return xp.concat(seen, axis=1)

    def height(self, state: State) -> Array:
        """Return how high the body is [m], (n,)."""
        return self.floor + state.qpos[:, 1]

    def terminated(self, state: State) -> Array:
        """Return whether the body is down, (n,)."""
        return self.height(state) < self.lowest

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return the reward for distance or height, less the cost of energy, (n,)."""
        if self.goal == "distance":
            speed = (after.qpos[:, 0] - before.qpos[:, 0]) / self.dt
            gain = self.xp.clip(speed, None, self.fastest)
        else:
            gain = self.height_reward * self.xp.clip(self.height(after) - self.straight, 0.0, None)
        return (gain - self.energy_cost * self.power(after)) * self.dt

    def with_distance_reward(self) -> Self | None:
        """Return the task without a largest speed that is paid; None where height is paid."""
        if self.goal != "distance":
            return None
        other = copy(self)
        other.fastest = np.inf
        return other

    def write_base_pose(
        self,
        qpos: np.ndarray,
        qvel: np.ndarray,
        orientation: np.ndarray | None,
        gyro: np.ndarray | None,
        position: np.ndarray | None,
    ) -> None:
        """Write where the body is along the boom and above the ground, where it is tracked."""
        if position is not None:
            qpos[:, 0], qpos[:, 1] = position[:, 0], position[:, 2] - self.floor
