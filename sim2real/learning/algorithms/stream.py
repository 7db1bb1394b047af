"""An endless stream of episodes: rows that restart by themselves, and can be saved in mid-air.

    stream = EpisodeStream(rows, tasks, np.random.default_rng(0))
    step = stream.step(action)          # (N, A); step.observation is that of before a restart
    stream.observation                  # (N, O): what the policy sees next

An episode is a pure function of its actions, parameters and seed, so that is what a saved stream
holds; loading plays the episodes in progress again, which is exact for every world and effect.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from envs.randomization import Tasks
from envs.rows import Rows, Step
from sim2real.runs.errors import CheckpointError

WINDOW = 100  # episodes that the reported return averages over


class EpisodeStream:
    """N episodes at a time, each with parameters and luck of its own.

    Args:
        rows: the world.
        tasks: draws the parameters of each episode (or row, as its `per` says).
        rng: where draws and seeds come from.

    Attributes:
        observation: what each row shows now, (N, O) float64.
        frames: steps of all rows so far.

    Raises:
        ParameterError: tasks that do not fit the rows.
    """

    def __init__(self, rows: Rows, tasks: Tasks, rng: np.random.Generator) -> None:
        tasks.check(rows.space)
        count = rows.num_rows
        self.rows, self._tasks, self._rng = rows, tasks, rng
        self._per_row = tasks.per == "row"
        self._values = rows.space.points(count)  # (N, P)
        self._drawn = np.zeros(count, bool)
        self._seeds = np.zeros(count, np.uint64)
        self._ages = np.zeros(count, np.int64)  # steps of the episode so far
        self._actions = np.zeros((rows.max_steps, count, rows.action_size), np.float32)
        self._returns = np.zeros(count)
        self._ids = np.arange(count)
        self._ended: deque[tuple[float, int]] = deque(maxlen=WINDOW)
        self.failures = self.frames = 0
        self.observation = np.zeros((count, rows.observation_size))
        self._restart(self._ids)

    def step(self, action: np.ndarray) -> Step:
        """Advance all rows by actions (N, A) float32 and restart those that end."""
        self._actions[self._ages, self._ids] = action
        step = self.rows.step(None, action.astype(np.float64))
        self._ages += 1
        self._returns += step.reward
        self.frames += len(action)
        self.observation = step.observation
        over = step.terminated | step.truncated
        if over.any():
            ids = np.flatnonzero(over)
            self.failures += int(step.failed.sum())
            self._ended.extend(
                zip(self._returns[ids].tolist(), self._ages[ids].tolist(), strict=True)
            )
            self.observation = step.observation.copy()  # the rows may reuse theirs
            self._restart(ids)
        return step

    def _restart(self, ids: np.ndarray) -> None:
        drawn = ids[~self._drawn[ids]] if self._per_row else ids
        if len(drawn):
            self._values[drawn] = self._tasks.sample(self._rng, len(drawn))
            self._drawn[drawn] = True
        self._seeds[ids] = self._rng.integers(0, 2**63, len(ids)).astype(np.uint64)
        self._ages[ids], self._returns[ids] = 0, 0.0
        self.observation[ids] = self.rows.reset(ids, self._values[ids], self._seeds[ids])

    def summary(self) -> dict[str, float]:
        """Return mean return and length of the last episodes; NaN before the first has ended."""
        if not self._ended:
            return {"train/return": float("nan"), "train/episode_length": float("nan")}
        returns, lengths = zip(*self._ended, strict=True)
        return {
            "train/return": float(np.mean(returns)),
            "train/episode_length": float(np.mean(lengths)),
        }

    def state_dict(self) -> dict[str, Any]:
        """Return the episodes in progress and what comes after them."""
        return {
            "rng": self._rng.bit_generator.state,
            "values": self._values.copy(),
            "drawn": self._drawn.copy(),
            "seeds": self._seeds.copy(),
            "ages": self._ages.copy(),
            "actions": self._played(),
            "ended": list(self._ended),
            "counts": (self.failures, self.frames),
        }

    def _played(self) -> np.ndarray:
        """Return the actions of the episodes in progress, (T, N, A), 0 where there are none yet."""
        longest = int(self._ages.max())
        now = np.arange(longest)[:, None] < self._ages  # (T, N); else left from episodes before
        return np.where(now[:, :, None], self._actions[:longest], np.float32(0.0))

    def refuse_other_rows(self, state: dict[str, Any]) -> None:
        """Raise CheckpointError for a state of another number of rows."""
        there, here = len(state["seeds"]), len(self._seeds)
        if there != here:
            raise CheckpointError(
                f"checkpoint: it has {there} rows, this run {here}; set algorithm.num_rows={there}"
            )

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go back to a state, playing its episodes in progress again.

        Raises:
            CheckpointError: for a state of another number of rows.
        """
        self.refuse_other_rows(state)
        self._rng.bit_generator.state = state["rng"]
        self._values[:], self._drawn[:] = state["values"], state["drawn"]
        self._seeds[:] = state["seeds"]
        self._actions[: len(state["actions"])] = state["actions"]
        self._ended = deque(((r, n) for r, n in state["ended"]), maxlen=WINDOW)
        self.failures, self.frames = state["counts"]
        self._replay(state["ages"])

    def _replay(self, ages: np.ndarray) -> None:
        self.observation = self.rows.reset(self._ids, self._values, self._seeds).copy()
        self._returns[:], self._ages[:] = 0.0, ages
        for age in range(int(ages.max())):
            ids = np.flatnonzero(ages > age)
            step = self.rows.step(ids, self._actions[age, ids].astype(np.float64))
            self.observation[ids] = step.observation
            self._returns[ids] += step.reward
