"""Returns and lengths of the episodes in batches of steps, whatever was done to their rewards."""

from collections import deque
from typing import Any

import numpy as np
from tensordict import TensorDictBase

WINDOW = 100  # episodes that the reported return averages over
RAW = ("next", "raw_reward")  # where rewards are kept that something has scaled


class EpisodeReturnTracker:
    """Follows N rows.

    Args:
        num_rows: N.
    """

    def __init__(self, num_rows: int) -> None:
        self._returns, self._lengths = np.zeros(num_rows), np.zeros(num_rows, np.int64)
        self._ended: deque[tuple[float, int]] = deque(maxlen=WINDOW)
        self.failures = 0

    def note(self, data: TensorDictBase) -> None:
        """Take a batch of steps (N, T) into account."""
        reward = data.get(RAW, None)
        reward = data["next", "reward"] if reward is None else reward
        over = np.asarray(data["next", "done"][..., 0].cpu())
        failed = data.get(("next", "failed"), None)
        self.failures += 0 if failed is None else int(failed.sum())
        for paid, done in zip(np.asarray(reward[..., 0].cpu()).T, over.T, strict=True):
            self._returns += paid
            self._lengths += 1
            if done.any():
                pairs = zip(self._returns[done].tolist(), self._lengths[done].tolist(), strict=True)
                self._ended.extend(pairs)
                self._returns[done], self._lengths[done] = 0.0, 0

    def summary(self) -> dict[str, float]:
        """Return mean return and length of the last episodes; NaN before the first has ended."""
        mean = np.mean(self._ended, axis=0) if self._ended else (float("nan"), float("nan"))
        return {
            "train/return": float(mean[0]),
            "train/episode_length": float(mean[1]),
            "train/failed": float(self.failures),
        }

    def restart(self) -> None:
        """Let every row begin an episode; those that have ended stay."""
        self._returns[:], self._lengths[:] = 0.0, 0

    def state_dict(self) -> dict[str, Any]:
        """Return the state: running and finished episodes."""
        return {
            "returns": self._returns.copy(),
            "lengths": self._lengths.copy(),
            "ended": list(self._ended),
            "failures": self.failures,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take over a state that `state_dict` returned."""
        self._returns, self._lengths = state["returns"].copy(), state["lengths"].copy()
        self._ended = deque(((r, n) for r, n in state["ended"]), maxlen=WINDOW)
        self.failures = state["failures"]
