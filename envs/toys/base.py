"""Base class of the small tasks: rows with parameter values, step counts and clipped actions."""

from abc import ABC, abstractmethod
from typing import Literal

import numpy as np

from envs.effects.base import Effect
from envs.errors import ParameterError, TaskError
from envs.params import ParamSpace
from envs.rows import Step

Selection = np.ndarray | slice


class Toy(ABC):
    """N rows of a task whose state is a few numbers.

    A subclass says how an episode starts and moves, its reward and its observation.

    Args:
        num_rows: N, episodes at a time.
        space: the task's parameters.
        state_size: numbers of a row's state.
        observation_size: O.
        action_limit: largest size of each action, (A,), in the action's unit.
        max_steps: control steps of an episode.

    Raises:
        TaskError: for no rows or no steps.
    """

    def __init__(
        self,
        num_rows: int,
        space: ParamSpace,
        *,
        state_size: int,
        observation_size: int,
        action_limit: np.ndarray,
        max_steps: int,
    ) -> None:
        if num_rows < 1 or max_steps < 1:
            raise TaskError(f"num_rows={num_rows} and max_steps={max_steps} must be at least 1")
        self.num_rows, self.max_steps, self.space = num_rows, max_steps, space
        self.observation_size, self.action_size = observation_size, len(action_limit)
        self.action_low, self.action_high = -action_limit, action_limit
        self._values = space.points(num_rows)  # (N, P)
        self._state = np.zeros((num_rows, state_size))
        self._steps = np.zeros(num_rows, np.int64)

    def reset(self, ids: np.ndarray, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        """Start episodes in the rows ids with parameters (n, P) and seeds (n,).

        Returns the first observations, (n, O).

        Raises:
            ParameterError: for values outside the task's parameter space.
        """
        self._values[ids] = self.space.validate(values)
        self._steps[ids] = 0
        self._state[ids] = self._start(ids, np.asarray(seeds, np.uint64))
        return self._observe(ids)

    def step(self, ids: np.ndarray | None, action: np.ndarray) -> Step:
        """Advance the rows ids (None: all) by one control step of action (n, A).

        Raises:
            TaskError: for an action of the wrong shape.
        """
        rows: Selection = slice(None) if ids is None else ids
        count = self.num_rows if ids is None else len(ids)
        if action.shape != (count, self.action_size):
            raise TaskError(
                f"action must have shape ({count}, {self.action_size}), got {action.shape}"
            )
        clipped = np.minimum(np.maximum(action, self.action_low), self.action_high)
        self._steps[rows] += 1
        truncated = self._steps[rows] >= self.max_steps
        reward, terminated = self._advance(rows, clipped, truncated)
        failed = np.zeros(count, bool)
        return Step(self._observe(rows), reward, terminated, truncated & ~terminated, failed)

    @abstractmethod
    def _start(self, ids: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        """Return the states in which episodes of these seeds start, (n, state_size)."""

    @abstractmethod
    def _advance(
        self, rows: Selection, action: np.ndarray, truncated: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Move the rows' states; return reward (n,) and terminated (n,)."""

    @abstractmethod
    def _observe(self, rows: Selection) -> np.ndarray:
        """Return the rows' observations, (n, O)."""


class ToyTasks(ABC):
    """A distribution of a small task's parameters, as `envs.randomization.Tasks`.

    Args:
        space: the task's parameters.

    Attributes:
        distinct: all tasks, (n, P), where there are few; else None.
    """

    distinct: np.ndarray | None = None
    effects: tuple[Effect, ...] = ()
    per: Literal["reset", "row"] = "reset"

    def __init__(self, space: ParamSpace) -> None:
        self.space = space

    def check(self, space: ParamSpace) -> None:
        """Raise ParameterError if an environment of this space cannot take the draws."""
        if space.names != self.space.names:
            raise ParameterError(
                f"the tasks draw {', '.join(self.space.names)}; the environment has the parameters "
                f"{', '.join(space.names) or 'none'}; use the environment's own tasks"
            )

    @abstractmethod
    def sample(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Draw n tasks, (n, P)."""
