"""Four legs of position servos that walk: what quad8 and quad12 share.

The legs are fl, fr, bl, br. An action is added to the swings and extensions of a trot; see
`envs.tasks.servo.legs` for these coordinates.
"""

from copy import copy
from typing import ClassVar, Self

import mujoco
import numpy as np

from envs.physics.arrays import Array
from envs.tasks.base import State
from envs.tasks.servo.base import ServoTask, clock
from envs.tasks.servo.legs import Gait, joints, roll_pitch

OFFSETS = (0.0, np.pi, np.pi, 0.0)  # rad, of the legs fl, fr, bl, br: a trot


class Quadruped(ServoTask):
    """The Minitaur's walking task on a robot with n servos.

    After Song et al. 2020, "Rapidly adaptable legged robots via evolutionary meta-learning".

    Observation (n + 4,): roll and pitch [rad], the servos' angles [rad], sine and cosine of the
    trot's phase. Action (n,): four swings and four extensions [rad], and what a robot of more
    servos adds. Reward: min(v, 0.5 m/s) dt - 0.005 sum |torque speed| dt, with v the base's speed
    along x. It ends when the robot tilts by more than 0.6 rad.
    """

    gait: ClassVar[Gait]
    home_bend = 0.6  # rad, of the keyframe's legs
    reach = 0.3  # rad, of the actions
    fastest = 0.5  # m/s, the largest speed that is rewarded
    energy_cost = 0.005  # 1/W of the reward a second
    most_tilt = 0.6  # rad

    def setup(self, model: mujoco.MjModel) -> None:
        """Read off the model, and where each leg is in the trot."""
        super().setup(model)
        self._offsets = np.array(OFFSETS)

    def action_range(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and largest offsets [rad], (n,) each."""
        return np.full(model.nu, -self.reach), np.full(model.nu, self.reach)

    def target_angles(self, state: State, action: Array) -> Array:
        """Return hips and knees of the trot with swings and extensions added [rad], (N, 8)."""
        phase = clock(state, self.gait.frequency)[:, None] + self._offsets  # (N, 4)
        swing, extension = self.gait.pattern(phase, self.xp)
        legs = swing + action[:, :4], extension + action[:, 4:8]
        return joints(*legs, self.home_bend, self.xp)

    def observe(self, state: State) -> Array:
        """Return (roll, pitch, servo angles, sine and cosine of the phase), (N, n + 4)."""
        phase = clock(state, self.gait.frequency)
        xp, tilt = self.xp, roll_pitch(state.qpos[:, 3:7], self.xp)
        rhythm = xp.stack([xp.sin(phase), xp.cos(phase)], axis=1)
        return xp.concat([tilt, state.qpos[:, self.q], rhythm], axis=1)

    def terminated(self, state: State) -> Array:
        """Return whether roll or pitch exceeds its limit, (N,)."""
        tilt = self.xp.abs(roll_pitch(state.qpos[:, 3:7], self.xp))  # (N, 2)
        return self.xp.max(tilt, axis=1) > self.most_tilt

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return distance walked, at no more than the paid speed, less the energy's price, (N,)."""
        speed = (after.qpos[:, 0] - before.qpos[:, 0]) / self.dt
        return (
            self.xp.clip(speed, None, self.fastest) - self.energy_cost * self.power(after)
        ) * self.dt

    def with_distance_reward(self) -> Self:
        """Return the task without a largest speed that is paid."""
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
        """Write the base's position, orientation and angular velocity where they are measured."""
        if position is not None:
            qpos[:, :3] = position
        if orientation is not None:
            qpos[:, 3:7] = orientation
        if gyro is not None:
            qvel[:, 3:6] = gyro
