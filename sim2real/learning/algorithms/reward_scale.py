"""Rewards divided by how much discounted returns vary, so that one learning rate fits all tasks.

scale = RewardScale(num_rows=16, gamma=0.99)
reward = scale(reward, over)                # (T, N)
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from sim2real.learning.modules.normalizer import Normalizer

LIMIT = 10.0  # of a scaled reward


class RewardScale:
    """Keeps the deviation of each row's running discounted return, of all that was seen.

    Args:
        num_rows: N.
        gamma: discount of a step.
    """

    def __init__(self, num_rows: int, gamma: float) -> None:
        self._gamma = gamma
        self._running = np.zeros(num_rows)  # (N,)
        self._seen = Normalizer(1)

    def __call__(self, reward: np.ndarray, over: np.ndarray) -> np.ndarray:
        """Take rewards (T, N) and ends of episodes (T, N) into account; return scaled rewards."""
        returns = np.empty_like(reward)
        for t, ended in enumerate(over):
            self._running = self._running * self._gamma + reward[t]
            returns[t] = self._running
            self._running = np.where(ended, 0.0, self._running)
        off = returns - self._seen.mean
        self._seen.update(off.size, off.sum(keepdims=True)[0], np.square(off).sum(keepdims=True)[0])
        return np.clip(reward / self._seen.std, -LIMIT, LIMIT)

    def state_dict(self) -> dict[str, Any]:
        """Return what was seen and what runs."""
        running = torch.from_numpy(self._running.copy())
        return {"running": running, "seen": self._seen.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over a state that `state_dict` returned."""
        self._running = state["running"].numpy().copy()
        self._seen.load_state_dict(state["seen"])
