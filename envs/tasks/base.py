"""A task: observation, reward, and when an episode ends.

Its functions are pure functions of (n, ·) arrays. A task knows its model and its numbers, and
holds no state of an episode: one object serves any number of rows.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple

import mujoco
import numpy as np

from envs.errors import TaskError
from envs.noise import normal, uniform
from envs.quiet import no_deprecation_notice

if TYPE_CHECKING:
    from envs.effects.base import Effect


class State(NamedTuple):
    """The state of n simulations, and what a task asked to have derived from it."""

    qpos: np.ndarray  # (n, nq) [m, rad]
    qvel: np.ndarray  # (n, nv) [m/s, rad/s]
    extra: np.ndarray | None = None  # (n, ...): the task's `extra_field` of MjData
    forces: np.ndarray | None = None  # (n, bodies, 6) [N·m, N]: on each body, MjData's cfrc_ext
    command: CommandState | None = None  # of a task that makes commands of its actions
    goal: np.ndarray | None = None  # (n,) or (n, axes) of a task that has one; for the reward alone


class CommandState(NamedTuple):
    """What was asked of n robots last, and when in their episodes they are."""

    time: np.ndarray  # (n,) s from the episode's start
    action: np.ndarray  # (n, A) the last one, 0 before the first
    goal: np.ndarray  # (n, nu) the command that was made of it, the pose of the start before


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
    """

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
        """Return the effects, with values, that the task's robot has of its own; none by default.

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

    def command(self, state: State, action: np.ndarray) -> np.ndarray:
        """Return the actuators' commands, (n, nu), for actions (n, A) in a state (n)."""
        return action

    @abstractmethod
    def observe(self, state: State) -> np.ndarray:
        """Return the observations, (n, O) float64."""

    @abstractmethod
    def reward(
        self, before: State, after: State, action: np.ndarray, terminated: np.ndarray
    ) -> np.ndarray:
        """Return the rewards of one control step, (n,); action (n, A) as the policy gave it."""

    def velocity(self, before: State, after: State) -> np.ndarray:
        """Return the forward velocity between two states, (n,) [m/s]: of the first coordinate."""
        return forward_velocity(before.qpos, after.qpos, self.dt)

    def terminated(self, state: State) -> np.ndarray:
        """Return which episodes the task ends here, (n,) bool; none by default."""
        return np.zeros(len(state.qpos), dtype=bool)


def gymnasium_model(name: str) -> mujoco.MjSpec:
    """Return the spec of one of Gymnasium's own models, for its physics to the last digit.

    The search for constraint islands is switched off: a model of one kinematic tree has one
    island, so the solver gets the same problem and the same bits, a tenth sooner.
    """
    package = find_spec("gymnasium")
    if package is None or not package.submodule_search_locations:
        raise TaskError(f"the model {name} comes with Gymnasium: pip install 'gymnasium[mujoco]'")
    path = Path(package.submodule_search_locations[0], "envs/mujoco/assets", name)
    with no_deprecation_notice():
        spec = mujoco.MjSpec.from_file(str(path))
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_ISLAND)
    return spec


def forward_velocity(before: np.ndarray, after: np.ndarray, dt: float) -> np.ndarray:
    """Return the velocity along the first coordinate of qpos (n, nq) over dt [s], (n,) [m/s]."""
    return (after[:, 0] - before[:, 0]) / dt


def effort(action: np.ndarray) -> np.ndarray:
    """Return the sum of squares of each action (n, A), (n,)."""
    return np.square(action).sum(1)
