"""A task in many rows at once, on NumPy arrays: the fast path under every environment of this package.

    sim = Simulation(Hopper(), num_rows=256, effects=[make("link_mass", where="torso", how="set")])
    observation = sim.reset(np.arange(256), values, seeds)
    step = sim.step(None, action)

It is `Rows` (see `envs.rows` for the contract): a row's episode depends on its actions, parameters and seed alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from envs.effects.base import Effect
from envs.errors import TaskError
from envs.plant import Plant
from envs.rows import Step
from envs.tasks.base import State, Task


class Simulation:
    """num_rows independent episodes of a task.

    Args:
        task: what is simulated.
        num_rows: N, episodes at a time.
        effects: what may differ per row.
        threads: CPU threads; 0 for all cores.

    Raises:
        EffectError: an effect that the robot cannot have.
    """

    def __init__(self, task: Task, num_rows: int = 1, effects: Sequence[Effect] = (), threads: int = 0) -> None:
        self.task = task
        self.plant = Plant(task.spec(), effects, num_rows, threads)
        self.num_rows = num_rows
        self.max_steps = task.max_steps
        self.space = self.plant.space
        task.setup(self.plant.nominal)
        low, high = self.plant.model.actuator_ctrlrange.T
        self.action_low, self.action_high = low.copy(), high.copy()  # (A,)
        self.action_size = len(low)
        self._extra = None if task.extra_field is None else self.plant.batch.bind(task.extra_field)
        self._steps = np.zeros(num_rows, dtype=np.int64)  # (N,)
        self.observation_size = task.observe(self._state(None)).shape[1]

    def reset(self, ids: np.ndarray, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        """Start episodes in the rows ids (n,) with parameters (n, P) and seeds (n,); return observations (n, O)."""
        self.plant.set_params(ids, values)
        self.plant.reset(ids, *self.task.initial(seeds), seeds)
        self._steps[ids] = 0
        return self._observe(ids)

    def step(self, ids: np.ndarray | None, action: np.ndarray) -> Step:
        """Advance the rows ids (None: all) by one control step of action (n, A).

        Raises:
            TaskError: an action of the wrong shape.
        """
        rows = slice(None) if ids is None else ids
        n = self.num_rows if ids is None else len(ids)
        if action.shape != (n, self.action_size):
            raise TaskError(f"action must have shape ({n}, {self.action_size}), got {action.shape}")
        before = self._state(ids)
        before = before._replace(qpos=before.qpos.copy() if ids is None else before.qpos)
        if before.extra is not None and ids is None:
            before = before._replace(extra=before.extra.copy())
        failed = self.plant.step(ids, action, self.task.frame_skip)
        after = self._state(ids)
        terminated = self.task.terminated(after)
        reward = self.task.reward(before, after, action, terminated)
        if failed.any():
            reward = np.where(failed, 0.0, reward)
        self._steps[rows] += 1
        truncated = self._steps[rows] >= self.max_steps
        return Step(self._observe(ids, after), reward, terminated | failed, truncated, failed)

    def _state(self, ids: np.ndarray | None) -> State:
        rows = slice(None) if ids is None else ids
        extra = None if self._extra is None else self._extra[rows]
        return State(self.plant.qpos[rows], self.plant.qvel[rows], extra)

    def _observe(self, ids: np.ndarray | None, state: State | None = None) -> np.ndarray:
        state = state or self._state(ids)
        qpos, qvel = self.plant.measured(ids) if self.plant.measures else (state.qpos, state.qvel)
        return self.task.observe(State(qpos, qvel, state.extra))
