"""Bench1: one servo that turns a pendulum along a given motion."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from envs.physics.arrays import Array
from envs.tasks.base import State
from envs.tasks.servo.base import Fidelity, ServoTask, commanded

SINES = ((0.9, 0.4, 0.0), (0.5, 1.1, 1.0), (0.2, 2.3, 2.0))  # rad, 1/s, rad: what it shall follow


class Bench1(ServoTask):
    """Follow three sines at once, 0.4 to 2.3 turns a second, with the angle of a pendulum.

    Observation (6,): angle [rad], speed [rad/s], where it shall be now and one control step later
    [rad], how fast it shall be then [rad/s], and the last action. Action (1,): by how much the goal
    leads what it shall be one step later [rad], within 0.8. Reward: -|error| dt [rad s].

    Args:
        fidelity: "ideal" (a stiff position actuator) or "servo" (motor and firmware).
        robot: the robot's file: a name in conf/robot, a path, or what such a file holds.
        seconds: length of an episode [s].
    """

    asset = "bench1.xml"
    camera = "front"
    reach = 0.8  # rad

    def __init__(
        self,
        fidelity: Fidelity = "servo",
        robot: str | Mapping[str, Any] = "bench1",
        seconds: float = 5.0,
    ) -> None:
        super().__init__(fidelity, robot, seconds)

    def action_range(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Return how far the goal may lead [rad], (1,) each."""
        return np.array([-self.reach]), np.array([self.reach])

    def reference(self, time: Array) -> tuple[Array, Array]:
        """Return where the pendulum shall be [rad] and how fast [rad/s] at times (n,), (n,) each.

        Each sine grows over the first second, from rest.
        """
        xp = self.xp
        ramp = xp.clip(time, 0.0, 1.0)
        angle, speed = xp.zeros_like(time), xp.zeros_like(time)
        for size, frequency, phase in SINES:
            turn = 2.0 * np.pi * frequency * time + phase
            angle += size * ramp * xp.sin(turn)
            speed += size * ramp * 2.0 * np.pi * frequency * xp.cos(turn)
            speed += size * (time < 1.0) * xp.sin(turn)
        return angle, speed

    def target_angles(self, state: State, action: Array) -> Array:
        """Return where the pendulum shall be one step later, plus the action."""
        return self.reference(commanded(state).time + self.dt)[0][:, None] + action

    def observe(self, state: State) -> Array:
        """Return (angle, speed, reference now, next, its speed, last action), (n, 6)."""
        command = commanded(state)
        now, _ = self.reference(command.time)
        following, speed = self.reference(command.time + self.dt)
        seen = [state.qpos[:, self.q[0]], state.qvel[:, self.v[0]], now, following, speed]
        return self.xp.concat([self.xp.stack(seen, axis=1), command.action], axis=1)

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return -|error| dt [rad s], (n,)."""
        shall, _ = self.reference(commanded(after).time)
        return -self.xp.abs(after.qpos[:, self.q[0]] - shall) * self.dt
