"""EasiAnt: Isaac Gym's ant, which runs along x, with the weights of EASI's released task.

After Dong et al., "EASI" (2024), and Makoviychuk et al., "Isaac Gym" (2021).
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

from envs.models import load_spec
from envs.noise import uniform
from envs.tasks.base import State, Task, effort

MODEL = Path(__file__).parents[1] / "assets" / "easi_ant.xml"
FREE = 7  # numbers of the torso's pose
TARGET = np.array([1000.0, 0.0])  # m, where it runs to


class EasiAnt(Task):
    """Run along x on four legs.

    Observation (60,): the torso's height [m], velocity and angular velocity in its own frame, yaw,
    roll and the angle to the target [rad], the cosines of its up and forward axes with up and the
    target, the joints' angles in [-1, 1] of their ranges, their speeds times 0.2, force and torque
    at each foot times 0.1, and the last action. Action (8,): torques in [-1, 1] times 15 N·m.
    Reward: the speed towards the target + 0.5 + 0.1 upright + 0.5 towards the target - 0.005
    action² - 0.05 |action · joint speed| - 0.1 a joint at its end, and -2 on the step that ends
    with the torso below 0.31 m.

    Args:
        max_steps: control steps an episode (1/60 s each).
    """

    frame_skip = 4
    camera = "track"
    commands = True
    extra_field = "sensordata"
    start_height, lowest = 0.44, 0.31  # m
    angles, speeds = 0.2, 0.1  # rad, rad/s: half widths of the joints' uniform starts
    speed_scale, force_scale = 0.2, 0.1
    alive, upright, heading = 0.5, 0.1, 0.5  # paid
    up_from, ahead_from = 0.93, 0.8  # cosines from which these are paid in full
    action_cost, energy_cost, limit_cost = 0.005, 0.05, 0.1
    at_limit = 0.99  # of a joint's range
    death = -2.0

    def __init__(self, max_steps: int = 200) -> None:
        self.max_steps = max_steps

    def spec(self) -> mujoco.MjSpec:
        """Return the model of assets/easi_ant.xml."""
        return load_spec(MODEL)

    def setup(self, model: mujoco.MjModel) -> None:
        """Read off the joints' ranges, too."""
        super().setup(model)
        self._low, self._high = model.jnt_range[1:].T  # (8,) each
        self.start[2] = self.start_height
        self.start[FREE:] = np.clip(0.0, self._low, self._high)

    def initial(self, seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the torso at rest and joints near their start, within their ranges."""
        angles, speeds = (2.0 * uniform(seeds, s, len(self._low)) - 1.0 for s in (0, 1))
        qpos, qvel = np.tile(self.start, (len(seeds), 1)), np.zeros((len(seeds), self.nv))
        qpos[:, FREE:] = np.clip(qpos[:, FREE:] + self.angles * angles, self._low, self._high)
        qvel[:, FREE - 1 :] = self.speeds * speeds
        return qpos, qvel

    def observe(self, state: State) -> np.ndarray:
        """Return what the class says, (n, 60)."""
        assert state.command is not None and state.extra is not None
        axes = _axes(state.qpos[:, 3:FREE])  # (n, 3, 3)
        velocity = np.einsum("nij,ni->nj", axes, state.qvel[:, :3])
        yaw = np.arctan2(axes[:, 1, 0], axes[:, 0, 0])
        roll = np.arctan2(axes[:, 2, 1], axes[:, 2, 2])
        way = TARGET - state.qpos[:, :2]
        off = _wrapped(np.arctan2(way[:, 1], way[:, 0]) - yaw)
        turned = np.stack([yaw, roll, off, axes[:, 2, 2], self._ahead(state)], axis=1)
        return np.hstack(
            [
                state.qpos[:, 2:3],
                velocity,
                state.qvel[:, 3:6],
                turned,
                self._scaled(state),
                self.speed_scale * state.qvel[:, 6:],
                self.force_scale * state.extra,
                state.command.action,
            ]
        )

    def terminated(self, state: State) -> np.ndarray:
        """Return whether the torso is too low, (n,)."""
        return ~(state.qpos[:, 2] >= self.lowest)

    def reward(
        self, before: State, after: State, action: np.ndarray, terminated: np.ndarray
    ) -> np.ndarray:
        """Return what the class says, (n,)."""
        action = np.clip(action, -1.0, 1.0)
        ahead = np.minimum(self._ahead(after) / self.ahead_from, 1.0)
        up = _axes(after.qpos[:, 3:FREE])[:, 2, 2] > self.up_from
        cost = self.action_cost * effort(action)
        cost += self.energy_cost * np.abs(action * self.speed_scale * after.qvel[:, 6:]).sum(1)
        cost += self.limit_cost * (self._scaled(after) > self.at_limit).sum(1)
        paid = self.velocity(before, after) + self.alive + self.upright * up + self.heading * ahead
        return np.where(terminated, self.death, paid - cost)

    def velocity(self, before: State, after: State) -> np.ndarray:
        """Return the speed towards the target, (n,) [m/s]."""
        far = [np.linalg.norm(TARGET - state.qpos[:, :2], axis=1) for state in (before, after)]
        return (far[0] - far[1]) / self.dt

    def _ahead(self, state: State) -> np.ndarray:
        """Return the cosine between the torso's forward axis and the way to the target, (n,)."""
        way = TARGET - state.qpos[:, :2]
        way = way / np.linalg.norm(way, axis=1, keepdims=True)
        return (_axes(state.qpos[:, 3:FREE])[:, :2, 0] * way).sum(1)

    def _scaled(self, state: State) -> np.ndarray:
        """Return the joints' angles in [-1, 1] of their ranges, (n, 8)."""
        return (2 * state.qpos[:, FREE:] - self._low - self._high) / (self._high - self._low)


def _axes(quats: np.ndarray) -> np.ndarray:
    """Return the rotation matrices of quaternions (n, 4), (n, 3, 3); columns are the axes."""
    w, x, y, z = (quats / np.linalg.norm(quats, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """Return angles within ± pi."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
