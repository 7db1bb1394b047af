"""A task: observation, reward, and when an episode ends.

Its functions are pure functions of (n, ·) arrays. A task knows its model and its numbers, and
holds no state of an episode: one object serves any number of rows. `initial` gets and returns
NumPy's arrays; what runs at each step computes in `self.xp`, the Array API's namespace, so that one
text serves NumPy and torch (see `Task.on`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Self

import mujoco
import numpy as np

from envs.errors import TaskError
from envs.noise import normal, uniform
from envs.physics.arrays import Array, Arrays
from envs.quiet import no_deprecation_notice

if TYPE_CHECKING:
    from envs.effects.base import Effect


class State(NamedTuple):
    """The state of n simulations, and what a task asked to have derived from it."""

    qpos: Array  # (n, nq) [m, rad]
    qvel: Array  # (n, nv) [m/s, rad/s]
    extra: Array | None = None  # (n, ...): the task's `extra_field` of MjData
    forces: Array | None = None  # (n, bodies, 6) [N·m, N]: on each body, MjData's cfrc_ext
    command: CommandState | None = None  # of a task that makes commands of its actions
    goal: Array | None = None  # (n,) or (n, axes) of a task that has one; for the reward alone


class CommandState(NamedTuple):
    """The last actions of n robots, and the times of their episodes."""

    time: Array  # (n,) s from the episode's start
    action: Array  # (n, A) the last one, 0 before the first
    goal: Array  # (n, nu) the command that was made of it, the pose of the start before


class Task(ABC):
    """One task on one robot.

    Attributes:
        frame_skip: physics substeps per control step.
        max_steps: control steps an episode.
        camera: name of the model's camera that shows the task, or None for a free one.
        extra_field: a further MjData field that `reward` or `observe` needs, one substep old as
            after mj_step.
        contact_forces: whether it needs the external forces on the bodies too, which cost much.
        reset_noise: largest, or for normal velocities standard, deviation of the starting state
            from the model's own.
        velocity_noise: law of the noise on the starting velocities.
        commands: whether `command` makes the actuators' commands of the actions; else they are the
            actions.
        has_goal: whether its reward asks for a goal, the parameter `goal`; see `envs.effects.Goal`.
        goal_axes: numbers of a goal: 1, or 2 for a point of the plane.
        array_api: whether `command`, `observe`, `reward` and `terminated` call `xp` for all they
            do with arrays, so that the task also runs where torch's are; see `on`.
        xp: the Array API's namespace of the arrays that these functions get.
    """

    array_api: ClassVar[bool] = False
    xp: Any = np

    has_goal: ClassVar[bool] = False
    goal_axes: ClassVar[int] = 1
    frame_skip: ClassVar[int]
    max_steps: int = 1000
    camera: ClassVar[str | None] = None
    extra_field: ClassVar[str | None] = None
    contact_forces: bool = False
    reset_noise: ClassVar[float]
    velocity_noise: ClassVar[Literal["uniform", "normal"]] = "uniform"
    commands: ClassVar[bool] = False

    @abstractmethod
    def spec(self) -> mujoco.MjSpec:
        """Return the robot's model."""

    def setup(self, model: mujoco.MjModel) -> None:
        """Read off the nominal model what the task's functions need."""
        self.dt = model.opt.timestep * self.frame_skip
        self.start = model.qpos0.copy()
        self.nv = model.nv

    def on(self, arrays: Arrays) -> Self:
        """Return the task for an engine's arrays: itself for NumPy's, else a copy with its own.

        Raises:
            TaskError: a task that is written for NumPy alone.
        """
        if arrays.on_host:
            return self
        if not self.array_api or self.contact_forces:
            raise TaskError(
                f"{type(self).__name__} computes with NumPy only"
                f"{', contact forces' if self.contact_forces else ''}; use physics=batch, or write "
                "its functions with self.xp and set array_api = True"
            )
        other = copy(self)
        other.xp = arrays.xp
        for name, value in vars(self).items():
            setattr(other, name, arrays.own(value))
        return other

    def initial(self, seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the states in which episodes of the seeds (n,) start: (n, nq), (n, nv)."""
        n = len(seeds)
        noise = self.reset_noise * (2.0 * uniform(seeds, 0, len(self.start)) - 1.0)
        if self.velocity_noise == "normal":
            qvel = self.reset_noise * normal(seeds, 1, self.nv)
        else:
            qvel = self.reset_noise * (2.0 * uniform(seeds, 1, self.nv) - 1.0)
        return np.tile(self.start, (n, 1)) + noise, qvel

    def fixed(self) -> Sequence[tuple[Effect, Sequence[float]]]:
        """Return the effects, with values, that the task's robot always has; none by default.

        One that the user fixes or draws at the same place replaces it.
        """
        return ()

    def action_range(self, model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
        """Return the least and the largest action, (A,) each: the actuators' ranges by default."""
        low, high = model.actuator_ctrlrange.T
        return low.copy(), high.copy()

    def rest(self, model: mujoco.MjModel) -> np.ndarray:
        """Return the command held before an episode of a task that commands, (nu,)."""
        return np.zeros(model.nu)

    def command(self, state: State, action: Array) -> Array:
        """Return the actuators' commands, (n, nu), for actions (n, A) in a state (n)."""
        return action

    @abstractmethod
    def observe(self, state: State) -> Array:
        """Return the observations, (n, O)."""

    @abstractmethod
    def reward(self, before: State, after: State, action: Array, terminated: Array) -> Array:
        """Return the rewards of one control step, (n,); action (n, A) as the policy gave it."""

    def velocity(self, before: State, after: State) -> Array:
        """Return the forward velocity between two states, (n,) [m/s]: of the first coordinate."""
        return forward_velocity(before.qpos, after.qpos, self.dt)

    def terminated(self, state: State) -> Array:
        """Return which episodes the task ends here, (n,) bool; none by default."""
        return self.xp.zeros_like(state.qpos[:, 0], dtype=self.xp.bool)

    def effort(self, action: Array) -> Array:
        """Return the sum of squares of each action (n, A), (n,)."""
        return self.xp.sum(self.xp.square(action), axis=1)

    def finite(self, state: State) -> Array:
        """Return in which states (n) all positions and velocities are finite, (n,)."""
        xp = self.xp
        return xp.all(xp.isfinite(state.qpos), axis=1) & xp.all(xp.isfinite(state.qvel), axis=1)


class GymnasiumTask(Task):
    """A task on one of Gymnasium's own models.

    Args:
        max_steps: control steps an episode.

    Attributes:
        asset: the model's file.
    """

    asset: ClassVar[str]

    def __init__(self, max_steps: int = 1000) -> None:
        self.max_steps = max_steps

    def spec(self) -> mujoco.MjSpec:
        """Return Gymnasium's model, for its physics to the last digit.

        The search for constraint islands is switched off: a model of one kinematic tree has one
        island, so the solver gets the same problem and the same bits, a tenth sooner.
        """
        package = find_spec("gymnasium")
        if package is None or not package.submodule_search_locations:
            raise TaskError(
                f"the model {self.asset} comes with Gymnasium: pip install 'gymnasium[mujoco]'"
            )
        path = Path(package.submodule_search_locations[0], "envs/mujoco/assets", self.asset)
        with no_deprecation_notice():
            spec = mujoco.MjSpec.from_file(str(path))
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
        return spec


def forward_velocity(before: Array, after: Array, dt: float) -> Array:
    """Return the velocity along the first coordinate of qpos (n, nq) over dt [s], (n,) [m/s]."""
    return (after[:, 0] - before[:, 0]) / dt
