"""EasiAnt: Isaac Gym's ant, which runs along x, with the weights of EASI's released task.

After Dong et al., "EASI" (2024), and Makoviychuk et al., "Isaac Gym" (2021).
"""

from pathlib import Path

import mujoco
import numpy as np

from envs.models import load_spec
from envs.noise import uniform
from envs.physics.arrays import Array
from envs.tasks.base import State, Task

MODEL = Path(__file__).parents[1] / "assets" / "easi_ant.xml"
FREE = 7  # numbers of the torso's pose
TARGET = (1000.0, 0.0)  # m, where it runs to


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

    array_api = True
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
        self._target = np.array(TARGET)
        self.start[2] = self.start_height
        self.start[FREE:] = np.clip(0.0, self._low, self._high)

    def initial(self, seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the torso at rest and joints near their start, within their ranges."""
        angles, speeds = (2.0 * uniform(seeds, s, len(self._low)) - 1.0 for s in (0, 1))
        qpos, qvel = np.tile(self.start, (len(seeds), 1)), np.zeros((len(seeds), self.nv))
        qpos[:, FREE:] = np.clip(qpos[:, FREE:] + self.angles * angles, self._low, self._high)
        qvel[:, FREE - 1 :] = self.speeds * speeds
        return qpos, qvel

    def observe(self, state: State) -> Array:
        """Return the observation that the class describes, (n, 60)."""
        assert state.command is not None and state.extra is not None
        xp, axes = self.xp, self._axes(state)  # (n, 3, 3)
        velocity = xp.sum(axes * state.qvel[:, :3, None], axis=1)
        yaw = xp.atan2(axes[:, 1, 0], axes[:, 0, 0])
        roll = xp.atan2(axes[:, 2, 1], axes[:, 2, 2])
        way = self._target - state.qpos[:, :2]
        off = _wrapped(xp.atan2(way[:, 1], way[:, 0]) - yaw)
        turned = xp.stack([yaw, roll, off, axes[:, 2, 2], self._ahead(state)], axis=1)
        return xp.concat(
            [
                state.qpos[:, 2:3],
                velocity,
                state.qvel[:, 3:6],
                turned,
                self._scaled(state),
                self.speed_scale * state.qvel[:, 6:],
                self.force_scale * state.extra,
                state.command.action,
            ],
            axis=1,
        )

    def terminated(self, state: State) -> Array:
        """Return whether the torso is too low, (n,)."""
        return ~(state.qpos[:, 2] >= self.lowest)

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return the reward that the class describes, (n,)."""
        xp = self.xp
        action = xp.clip(action, -1.0, 1.0)
        ahead = xp.clip(self._ahead(after) / self.ahead_from, None, 1.0)
        up = self._axes(after)[:, 2, 2] > self.up_from
        cost = self.action_cost * self.effort(action)
        used = xp.abs(action * self.speed_scale * after.qvel[:, 6:])
        cost += self.energy_cost * xp.sum(used, axis=1)
        cost += self.limit_cost * xp.sum(self._scaled(after) > self.at_limit, axis=1)
        paid = self.velocity(before, after) + self.alive + self.upright * up + self.heading * ahead
        return xp.where(terminated, self.death, paid - cost)

    def velocity(self, before: State, after: State) -> Array:
        """Return the speed towards the target, (n,) [m/s]."""
        return (self._far(before) - self._far(after)) / self.dt

    def _far(self, state: State) -> Array:
        """Return the distance to the target, (n,) [m]."""
        return self.xp.linalg.vector_norm(self._target - state.qpos[:, :2], axis=1)

    def _ahead(self, state: State) -> Array:
        """Return the cosine between the torso's forward axis and the way to the target, (n,)."""
        xp = self.xp
        way = self._target - state.qpos[:, :2]
        way = way / xp.linalg.vector_norm(way, axis=1, keepdims=True)
        return xp.sum(self._axes(state)[:, :2, 0] * way, axis=1)

    def _scaled(self, state: State) -> Array:
        """Return the joints' angles in [-1, 1] of their ranges, (n, 8)."""
        return (2 * state.qpos[:, FREE:] - self._low - self._high) / (self._high - self._low)

    def _axes(self, state: State) -> Array:
        """Return the rotation matrices of the torso, (n, 3, 3); columns are its axes."""
        xp, quats = self.xp, state.qpos[:, 3:FREE]
        w, x, y, z = (quats / xp.linalg.vector_norm(quats, axis=1, keepdims=True)).T
        rows = [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
        return xp.stack([xp.stack(row, axis=1) for row in rows], axis=1)


def _wrapped(angle: Array) -> Array:
    """Return angles within ± pi."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
