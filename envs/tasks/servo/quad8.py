"""Quad8: a four-legged robot of eight servos that is rewarded for walking forward cheaply."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Any, Self

import mujoco
import numpy as np

from envs.tasks.base import State
from envs.tasks.servo.base import Fidelity, ServoTask, clock
from envs.tasks.servo.legs import Gait, joints, roll_pitch

OFFSETS = np.array([0.0, np.pi, np.pi, 0.0])  # rad, of the legs fl, fr, bl, br: a trot


class Quad8(ServoTask):
    """The Minitaur's walking task on a robot of 1.1 kg with legs of 0.16 m.

    After Song et al. 2020, "Rapidly adaptable legged robots via evolutionary meta-learning".

    Observation (12,): roll and pitch [rad], eight servo angles [rad], sine and cosine of the trot's
    phase. Action (8,): what is added to the swings and to the extensions of the legs fl, fr, bl, br
    of a slow trot [rad], each within 0.3. Reward: min(v, 0.5 m/s) dt - 0.005 sum |torque speed| dt,
    with v the base's speed along x. It ends when the robot tilts by more than 0.6 rad.

    Args:
        fidelity: "ideal" (stiff position actuators) or "servo" (motor and firmware).
        robot: the robot's file: a name in conf/robot, a path, or what such a file holds.
        seconds: length of an episode [s].
    """

    asset = "quad8.xml"
    gait = Gait(frequency=2.0, swing=0.1, extension=0.15)
    home_bend = 0.6  # rad, of the keyframe's legs
    reach = 0.3  # rad, of the actions
    fastest = 0.5  # m/s, the largest speed that is rewarded
    energy_cost = 0.005  # 1/W of the reward a second
    most_tilt = 0.6  # rad

    def __init__(
        self,
        fidelity: Fidelity = "servo",
        robot: str | Mapping[str, Any] = "quad8",
        seconds: float = 3.0,
    ) -> None:
        super().__init__(fidelity, robot, seconds)

    def action_range(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and largest offsets [rad], (8,) each."""
        return np.full(8, -self.reach), np.full(8, self.reach)

    def wanted(self, state: State, action: np.ndarray) -> np.ndarray:
        """Return the trot with the action's swings and extensions added [rad], (n, 8)."""
        phase = clock(state, self.gait.frequency)[:, None] + OFFSETS  # (n, 4)
        swing, extension = self.gait.pattern(phase)
        return joints(swing + action[:, :4], extension + action[:, 4:], self.home_bend)

    def observe(self, state: State) -> np.ndarray:
        """Return (roll, pitch, servo angles, sine and cosine of the phase), (n, 12)."""
        phase = clock(state, self.gait.frequency)
        tilt = roll_pitch(state.qpos[:, 3:7])
        rhythm = np.stack([np.sin(phase), np.cos(phase)], axis=1)
        return np.concatenate([tilt, state.qpos[:, self.q], rhythm], axis=1)

    def terminated(self, state: State) -> np.ndarray:
        """Return whether the robot tilts too far, (n,)."""
        tilt = np.abs(roll_pitch(state.qpos[:, 3:7])).max(axis=1)  # (n,)
        return np.asarray(tilt > self.most_tilt)

    def reward(
        self, before: State, after: State, action: np.ndarray, terminated: np.ndarray
    ) -> np.ndarray:
        """Return distance walked, at no more than the paid speed, less the energy's price, (n,)."""
        speed = (after.qpos[:, 0] - before.qpos[:, 0]) / self.dt
        return (np.minimum(speed, self.fastest) - self.energy_cost * self.power(after)) * self.dt

    def by_distance(self) -> Self:
        """Return the task without a largest speed that is paid."""
        other = copy(self)
        other.fastest = np.inf
        return other

    def place(
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
