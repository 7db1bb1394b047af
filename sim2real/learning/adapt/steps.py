"""Sessions that receive every step of their episodes, for operators that `explores`.

    session.tell(value, EpisodeTrajectory(observation, action, reward, end))

Reported episodes are kept, and a session that is loaded receives the same ones again.
"""

from abc import abstractmethod
from typing import Any

import numpy as np
import torch

from hardware.log import Log
from sim2real.learning.adapt.base import Adaptation, EpisodeTrajectory, Session
from sim2real.runs.errors import Sim2RealError

COLUMNS = ("observation", "action", "reward")  # of a number or a vector for each step


class StepsSession(Session):
    """One robot's adaptation by the steps of its episodes; see `Session`.

    Args:
        operator: the recipe.
        theta: parameters before adaptation, (P,).
    """

    def __init__(self, operator: Adaptation, theta: np.ndarray) -> None:
        self._operator = operator
        self._restart(theta)

    def _restart(self, theta: np.ndarray) -> None:
        self._theta = np.array(theta, np.float32)
        self._values: list[float] = []
        self._steps: list[EpisodeTrajectory] = []
        self._result = self._theta

    @abstractmethod
    def _digest(self) -> None:
        """Update `_result` after each reported episode."""

    @property
    def result(self) -> np.ndarray:
        """The parameters adapted so far, (P,) float32; final when `ask` returns None."""
        return self._result.copy()

    def ask(self) -> np.ndarray | None:
        """Return the parameters to run for one episode, (P,) float32, or None when done."""
        return self.result if self.episodes_left else None

    def tell(
        self, value: float, steps: EpisodeTrajectory | None = None, log: Log | None = None
    ) -> None:
        """Report an episode whose actions were drawn: its return and its steps.

        Raises:
            Sim2RealError: when the adaptation is done, without steps, or for values that are not
                finite.
        """
        self._check(value, *(x for x in steps or () if x is not None))
        if steps is None:
            raise Sim2RealError(
                f"adaptation: {self._operator} needs each episode's steps as well as its return; "
                "give tell(value, steps)"
            )
        self._values.append(float(value))
        self._steps.append(steps)
        self._digest()

    def state_dict(self) -> dict[str, Any]:
        """Return the start, and the episodes so far one after the other, as tensors."""
        parts = {
            f"steps.{name}": torch.from_numpy(
                np.concatenate([getattr(one, name) for one in self._steps])
                if self._steps
                else np.zeros(0, np.float32)
            )
            for name in COLUMNS
        }
        none = np.nan  # what an episode that the task ended saw last
        ends = [one.observation[-1] * none if one.end is None else one.end for one in self._steps]
        return {
            "theta": torch.from_numpy(self._theta.copy()),
            "noise": torch.zeros(0, len(self._theta)),
            "values": torch.tensor(self._values, dtype=torch.float64),
            "lengths": torch.tensor([len(one.reward) for one in self._steps], dtype=torch.int64),
            "steps.end": torch.from_numpy(np.array(ends, np.float32)),
            **parts,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go back to where `state_dict` was taken, by telling the same episodes again."""
        self._restart(state["theta"].numpy())
        cuts = np.cumsum(state["lengths"].numpy())[:-1]
        columns = [np.split(state[f"steps.{name}"].numpy(), cuts) for name in COLUMNS]
        ends = state["steps.end"].numpy()
        for number, value in enumerate(state["values"].tolist()):
            end = None if np.isnan(ends[number]).any() else ends[number]
            observation, action, reward = (column[number] for column in columns)
            self.tell(value, EpisodeTrajectory(observation, action, reward, end))
