"""The rows of logs as one table whose columns can be shifted in time within an episode.

rows = Rows.of(logs)
rows.matrix(["qpos.hip", "qpos.knee"])          # (T, 2)
rows.older(values, 2)                           # each row's value two steps before
rows.deep(4)                                    # rows with four steps before them
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from envs.errors import did_you_mean
from hardware.log import Log
from sim2real.diagnosis.contract.terms import ContractError


def is_sent(log: Log) -> np.ndarray:
    """Return in which rows (T,) something was sent; in an episode's last one nothing may be."""
    return log.columns.get("flag.end", np.zeros(len(log))) == 0


@dataclass(frozen=True)
class Rows:
    """Rows of all episodes, one after the other."""

    columns: Mapping[str, np.ndarray]  # those that all logs have, (T,) each
    since: np.ndarray  # how many rows of the same episode lie before each, (T,)
    place: str  # the logs' names, for errors

    @staticmethod
    def of(logs: Sequence[Log]) -> Rows:
        """Join logs; rows in which an episode had ended are left out."""
        parts = [part for log in logs for part in log.episodes()]
        shared = [name for name in parts[0].columns if all(name in p.columns for p in parts)]
        columns = {
            name: np.concatenate([part.columns[name][is_sent(part)] for part in parts])
            for name in shared
        }
        since = np.concatenate([np.arange(is_sent(part).sum()) for part in parts])
        names = dict.fromkeys(str(log.path or "the log") for log in logs)
        return Rows(columns, since, ", ".join(names))

    def __len__(self) -> int:
        return len(self.since)

    def has(self, names: Sequence[str]) -> bool:
        """Return whether all of these columns are logged."""
        return all(name in self.columns for name in names)

    def matrix(self, names: Sequence[str]) -> np.ndarray:
        """Return columns side by side, (T, k).

        Raises:
            ContractError: one that the logs lack, with the nearest name.
        """
        for name in names:
            if name not in self.columns:
                raise ContractError(
                    f"{self.place}: unknown column {name!r}"
                    f"{did_you_mean(name, self.columns)}, which the description needs; log it, or "
                    "correct the description"
                )
        return np.stack([self.columns[name] for name in names], axis=1)

    def numbered(self, kind: str) -> np.ndarray | None:
        """Return the columns `kind.0`, `kind.1`, … side by side, (T, k); None if there are none."""
        count = 0
        while f"{kind}.{count}" in self.columns:
            count += 1
        return self.matrix([f"{kind}.{i}" for i in range(count)]) if count else None

    def older(self, values: np.ndarray, steps: int | np.ndarray) -> np.ndarray:
        """Return values (T, …) of `steps` rows before, one number for all or one each (T,).

        They are an episode's first where there are none.
        """
        back = np.minimum(self.since, steps)
        return values[np.arange(len(self)) - back]

    def smoothed(self, values: np.ndarray, share: float) -> np.ndarray:
        """Return y = share x + (1 - share) y of the row before, (T, k), from each episode's x."""
        made = np.array(values, float)
        for t in np.flatnonzero(self.since > 0):
            made[t] = share * values[t] + (1 - share) * made[t - 1]
        return made

    def deep(self, steps: int) -> np.ndarray:
        """Return the rows that have at least so many before them, (n,)."""
        return np.flatnonzero(self.since >= steps)
