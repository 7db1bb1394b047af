"""A task in many rows at once, on an engine's arrays: the fast path under every environment.

    sim = Simulation(Hopper(), num_rows=256, effects=[make("link_mass", where="torso", how="set")])
    observation = sim.reset(np.arange(256), values, seeds)
    step = sim.step(None, action)

It is `Rows` (see `envs.rows` for the contract): a row's episode depends on its actions, parameters
and seed alone.

A row fails when the engine raises an error or a warning in it (a diverged state, which the engine
would silently replace by its default one), when its observation or reward is not finite, or its
action is not. Its step then has failed and terminated set, reward 0 and an observation of zeros;
the other rows do not notice. Reset it before it goes on, as after any other end.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from envs.contact_forces import ContactForces
from envs.effects.base import Effect
from envs.effects.goal import Goals
from envs.errors import EffectError, TaskError
from envs.physics import Engine
from envs.physics.arrays import Array
from envs.plant import Fixed, Plant
from envs.quiet import no_deprecation_notice
from envs.rows import Step
from envs.tasks.base import CommandState, State, Task


class Simulation:
    """num_rows independent episodes of a task.

    Args:
        task: what is simulated.
        num_rows: N, episodes at a time.
        effects: what may differ per row.
        threads: CPU threads; 0 for all cores.
        fixed: effects that every row has, with their values, as `load_effects` returns them.
        physics: what steps the rows, `batch` or `warp`.
        device: where `warp` steps them.

    Raises:
        EffectError: an effect that the robot or the engine cannot have.
        ParameterError: a fixed value outside its range.
        TaskError: an engine that is not there, or that cannot step the task.
    """

    def __init__(
        self,
        task: Task,
        num_rows: int = 1,
        effects: Sequence[Effect] = (),
        threads: int = 0,
        fixed: Sequence[Fixed] = (),
        physics: Engine = "batch",
        device: Any = "cpu",
    ) -> None:
        self.task = task
        with no_deprecation_notice():
            self.plant = Plant(
                task.spec(),
                effects,
                num_rows,
                threads,
                persistent=task.contact_forces,
                fixed=_fixed(task, effects, fixed),
                goal=task.has_goal,
                physics=physics,
                device=device,
            )
        self.num_rows = num_rows
        self.arrays = arrays = self.plant.arrays
        if task.max_steps < 1:
            raise TaskError(f"max_steps={task.max_steps} must be at least 1 control step")
        self.max_steps = task.max_steps
        self.space = self.plant.space
        task.setup(self.plant.nominal)
        self._task = task.on(arrays)
        self.action_low, self.action_high = task.action_range(self.plant.nominal)  # (A,)
        self.action_size = len(self.action_low)
        self._extra = None
        if task.extra_field is not None:
            self._extra = self.plant.physics.bind(task.extra_field)
        self._goals = self._shared_goals() if task.has_goal else None  # (N,) or (N, axes)
        self._forces = ContactForces(self.plant) if task.contact_forces else None
        self._steps = arrays.zeros(num_rows, np.int64)  # (N,)
        self._seeds = np.zeros(num_rows, dtype=np.uint64)  # (N,), of the host
        self._rest = task.rest(self.plant.nominal)  # (nu,)
        self._action = arrays.zeros((num_rows, self.action_size))
        self._goal = arrays.own(np.tile(self._rest, (num_rows, 1)))
        self.observation_size = self._task.observe(self._state(slice(None))).shape[1]

    def _shared_goals(self) -> Array:
        """Return the rows' goals as the task's reward reads them; the effect `goal` writes them."""
        axes = self.task.goal_axes
        values = self.plant.shared_mechanism(
            "goal", lambda: Goals(self.num_rows, self.arrays, axes)
        ).values
        if values.shape[1] != axes:
            raise EffectError(
                f"goal: axes={values.shape[1]}, {type(self.task).__name__} asks for {axes}; give "
                "the effect as many axes, or take the task's own params"
            )
        return values[:, 0] if axes == 1 else values

    def reset(self, ids: np.ndarray, values: np.ndarray, seeds: np.ndarray) -> Array:
        """Start episodes in the rows ids (n,), with parameters (n, P) and seeds (n,).

        Returns:
            The first observations, (n, O).

        Raises:
            ParameterError: a value outside its parameter's range; nothing was written then.
        """
        ids = np.asarray(ids)
        self.plant.set_params(ids, values)
        self._steps[self.arrays.rows(ids)] = 0
        self._seeds[ids] = seeds
        return self.set_state(ids, *self.task.initial(self._seeds[ids]))

    def set_state(self, ids: np.ndarray, qpos: np.ndarray, qvel: np.ndarray) -> Array:
        """Put rows into a state as if their episodes had started there.

        Parameters, seed and the time that counts towards `max_steps` stay.

        Args:
            ids: sorted, unique rows, (n,).
            qpos: positions [m, rad], (n, nq).
            qvel: velocities [m/s, rad/s], (n, nv).

        Returns:
            The observations, (n, O).

        Raises:
            TaskError: a wrong shape, or a state that is not finite.
        """
        for name, given, size in (
            ("qpos", qpos, self.task.start.size),
            ("qvel", qvel, self.task.nv),
        ):
            if np.shape(given) != (len(ids), size):
                raise TaskError(
                    f"{name} must have shape ({len(ids)}, {size}), got {np.shape(given)}"
                )
            if not np.isfinite(given).all():
                raise TaskError(f"{name} holds NaN or infinity; give finite numbers")
        rows, held = self.arrays.rows(ids), np.tile(self._rest, (len(ids), 1))
        self._action[rows], self._goal[rows] = 0.0, self.arrays.own(self._rest)
        self.plant.reset(ids, qpos, qvel, self._seeds[ids], held if self.task.commands else None)
        if self._forces:
            self._forces.clear(ids)
        return self._observe(rows, self._state(rows))

    def step(self, ids: np.ndarray | None, action: Array) -> Step:
        """Advance the rows ids (None: all) by one control step of action (n, A).

        Raises:
            TaskError: an action of the wrong shape.
        """
        rows, xp = self.arrays.rows(ids), self.arrays.xp
        n = self.num_rows if ids is None else len(ids)
        action, refused = self._checked(action, n)
        # views of what the step changes, where all rows step
        before = self.state() if ids is None else self._state(rows)
        goal = self._task.command(before, action)
        failed = self.plant.step(ids, goal, self.task.frame_skip)
        self._steps[rows] += 1
        if self.task.commands:
            self._action[rows], self._goal[rows] = action, goal
        if self._forces:
            self._forces.compute(ids)
        after = self._state(rows)
        with np.errstate(
            invalid="ignore", over="ignore"
        ):  # a failed row's numbers are replaced below
            terminated = self._task.terminated(after)
            reward = self._task.reward(before, after, action, terminated)
            observation = self._observe(rows, after)
            failed |= self._not_finite(observation) | self._not_finite(reward[:, None])
        if refused is not None:
            failed |= refused
        if not self.arrays.on_host or failed.any():  # a device is not asked in between
            reward = xp.where(failed, 0.0, reward)
            observation = xp.where(failed[:, None], 0.0, observation)
            terminated = terminated | failed
        truncated = self._steps[rows] >= self.max_steps
        return Step(observation, reward, terminated, truncated, failed)

    def _checked(self, action: Array, n: int) -> tuple[Array, Array | None]:
        """Return the action with 0 in rows that are not finite, and those rows if any."""
        if action.shape != (n, self.action_size):
            shape = tuple(action.shape)
            raise TaskError(f"action must have shape ({n}, {self.action_size}), got {shape}")
        xp = self.arrays.xp
        finite = xp.isfinite(action)
        if self.arrays.on_host and finite.all():
            return action, None
        refused = ~xp.all(finite, axis=1)
        return xp.where(refused[:, None], 0.0, action), refused

    def _not_finite(self, x: Array) -> Array:
        """Return which rows of x (n, k) hold NaN or infinity, (n,)."""
        xp = self.arrays.xp
        finite = xp.isfinite(x)
        if self.arrays.on_host and finite.all():
            return np.zeros(len(x), dtype=bool)
        return ~xp.all(finite, axis=1)

    def state(self, ids: np.ndarray | None = None) -> State:
        """Return a copy of the true state of the rows ids (None: all)."""
        here, xp = self._state(self.arrays.rows(ids)), self.arrays.xp
        return here._replace(
            qpos=xp.asarray(here.qpos, copy=True),
            qvel=xp.asarray(here.qvel, copy=True),
            extra=None if here.extra is None else xp.asarray(here.extra, copy=True),
            forces=None if here.forces is None else xp.asarray(here.forces, copy=True),
        )

    def _state(self, rows: Any) -> State:
        extra = None if self._extra is None else self._extra[rows]
        forces = None if self._forces is None else self._forces.values[rows]
        goal = None if self._goals is None else self._goals[rows]
        command = self._commanded(rows)
        return State(self.plant.qpos[rows], self.plant.qvel[rows], extra, forces, command, goal)

    def _commanded(self, rows: Any) -> CommandState | None:
        if not self.task.commands:
            return None
        xp, time = self.arrays.xp, self._steps[rows] * self.task.dt
        action, goal = self._action[rows], self._goal[rows]
        return CommandState(time, xp.asarray(action, copy=True), xp.asarray(goal, copy=True))

    def measured(self, ids: np.ndarray | None = None) -> State:
        """Return the state of the rows ids (None: all) as the robots' sensors report it."""
        return self._as_measured(self.arrays.rows(ids), self.state(ids))

    def _observe(self, rows: Any, state: State) -> Array:
        return self._task.observe(self._as_measured(rows, state))

    def _as_measured(self, rows: Any, state: State) -> State:
        if not self.plant.measures:
            return state
        qpos, qvel = self.plant.readings(rows)
        return state._replace(qpos=qpos, qvel=qvel)


def _fixed(task: Task, effects: Sequence[Effect], fixed: Sequence[Fixed]) -> list[Fixed]:
    """Return all fixed effects: the user's, and the task's own where the user says nothing."""
    given = {(effect.name, effect.where) for effect in [*effects, *(e for e, _ in fixed)]}
    own = [(e, values) for e, values in task.fixed() if (e.name, e.where) not in given]
    return [*own, *fixed]
