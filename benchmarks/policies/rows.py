"""Many rows of a task for other libraries' trainers: episodes that end begin again at once.

rows = Rows(task, 64, history=3)
seen = rows.reset()                                     # (N, H F), the newest frame first
seen, reward, ended, cut, last = rows.step(action)      # `last`: (N, H F) before the new start
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.simulation import Simulation
from envs.tasks.servo import ServoTask


class Moved(NamedTuple):
    """What a step of N rows came to."""

    seen: np.ndarray  # (N, H F)
    reward: np.ndarray  # (N,)
    ended: np.ndarray  # (N,) bool: the robot fell
    cut: np.ndarray  # (N,) bool: the time was over
    last: np.ndarray  # (N, H F), what was seen at the end of an episode


class Rows:
    """N episodes of a task side by side.

    Args:
        task: the task.
        count: N.
        history: H, frames that the policy sees.
        seed: of the starts.
    """

    def __init__(self, task: ServoTask, count: int, history: int = 1, seed: int = 0) -> None:
        self.simulation = Simulation(task, count, threads=1)
        self.count, self.actions = count, self.simulation.action_size
        self.steps = task.max_steps
        rest = task.rest(self.simulation.plant.nominal)
        self.pose = [round(float(angle), 6) for angle in rest]  # rad, as a description has it
        self._rng = np.random.default_rng(seed)
        self._frames = np.zeros((count, history, self.simulation.observation_size))
        self.size = self._frames[0].size

    def reset(self) -> np.ndarray:
        """Begin an episode in each row."""
        self._begin(np.arange(self.count))
        return self._seen()

    def step(self, action: np.ndarray) -> Moved:
        """Advance all rows by one control step of actions (N, A)."""
        step = self.simulation.step(None, np.asarray(action, float))
        self._frames[:, 1:] = self._frames[:, :-1].copy()
        self._frames[:, 0] = step.observation
        last = self._seen()
        over = step.terminated | step.truncated
        if over.any():
            self._begin(np.flatnonzero(over))
        return Moved(self._seen(), step.reward, step.terminated, step.truncated, last)

    def _begin(self, ids: np.ndarray) -> None:
        seeds = self._rng.integers(1 << 32, size=len(ids)).astype(np.uint64)
        first = self.simulation.reset(ids, np.zeros((len(ids), 0)), seeds)
        self._frames[ids] = first[:, None]

    def _seen(self) -> np.ndarray:
        return self._frames.reshape(self.count, -1).astype(np.float32)
