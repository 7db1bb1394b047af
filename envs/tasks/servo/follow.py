"""Follow: an arm of position servos follows slow sines, for any robot and model."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from envs.errors import TaskError
from envs.physics.arrays import Array
from envs.tasks.base import State
from envs.tasks.servo.base import ASSETS, Fidelity, ServoTask, commanded

SIZE = 0.25  # of a joint's range, the amplitude of its sine
FREQUENCIES = (0.31, 0.23, 0.41, 0.37, 0.47, 0.29)  # 1/s, in turn: no two joints beat together


class Follow(ServoTask):
    """Each joint of an arm follows its own sine about its pose at home.

    Observation (4 n,) of n servos: angles [rad], speeds [rad/s], where they shall be one control
    step later [rad], and the last action. Action (n,): by how much the goals lead that [rad],
    within 0.3. Reward: -(mean |error|) dt [rad s].

    Args:
        fidelity: "ideal" (a stiff position actuator) or "servo" (motor and firmware).
        robot: the robot's file: a name in conf/robot, a path, or what such a file holds.
        model: its MJCF: a path, or a file of envs/assets. Without a keyframe `home` the joints
            swing about their zeros.
        seconds: length of an episode [s].

    Raises:
        TaskError: there is no such model.
    """

    camera = None
    reach = 0.3  # rad

    def __init__(
        self,
        fidelity: Fidelity = "servo",
        robot: str | Mapping[str, Any] = "so101",
        model: str | None = None,
        seconds: float = 5.0,
    ) -> None:
        if model is None or not any(p.is_file() for p in (Path(model), ASSETS / model)):
            raise TaskError(
                f"Follow: no model {model!r}; give env.task.model=PATH, the robot's MJCF"
            )
        path = Path(model).resolve() if Path(model).is_file() else ASSETS / model
        self.asset = str(path)  # type: ignore[misc]
        super().__init__(fidelity, robot, seconds)

    def spec(self) -> mujoco.MjSpec:
        """Return the robot with its actuators at this fidelity, and a pose at home."""
        spec = super().spec()
        if "home" not in [key.name for key in spec.keys]:
            qpos = spec.copy().compile().qpos0
            spec.add_key(
                name="home", qpos=qpos, ctrl=np.clip(0, self.machine.low, self.machine.high)
            )
        return spec

    def setup(self, model: mujoco.MjModel) -> None:
        """Read off where each joint may swing: a quarter of its range about home, within it."""
        super().setup(model)
        low, high, home = self.machine.low, self.machine.high, model.key("home").ctrl
        self._size = SIZE * (high - low)  # (n,) rad
        self._middle = np.clip(home, low + self._size, high - self._size)
        self._frequency = np.resize(FREQUENCIES, len(home))

    def action_range(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Return how far the goals may lead [rad], (n,) each."""
        return np.full(model.nu, -self.reach), np.full(model.nu, self.reach)

    def reference(self, time: Array) -> Array:
        """Return where the joints shall be [rad] at times (n,), (n, servos).

        Each goes from home to its sine over the first second.
        """
        ramp = self.xp.clip(time, 0.0, 1.0)[:, None]
        swing = self._size * self.xp.sin(2.0 * np.pi * self._frequency * time[:, None])
        home = self.start[self.q]
        return home + ramp * (self._middle + swing - home)

    def target_angles(self, state: State, action: Array) -> Array:
        """Return where the joints shall be one step later, plus the action."""
        return self.reference(commanded(state).time + self.dt) + action

    def observe(self, state: State) -> Array:
        """Return (angles, speeds, reference one step later, last action), (n, 4 servos)."""
        command = commanded(state)
        following = self.reference(command.time + self.dt)
        seen = [state.qpos[:, self.q], state.qvel[:, self.v], following, command.action]
        return self.xp.concat(seen, axis=1)

    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return -(mean |error|) dt [rad s], (n,)."""
        error = after.qpos[:, self.q] - self.reference(commanded(after).time)
        return -self.xp.mean(self.xp.abs(error), axis=1) * self.dt
