"""The interface of a training algorithm: a verb drives it, saves it and asks it for its policy."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from torch import nn


class Algorithm(ABC):
    """Something that improves a policy, one iteration at a time.

    Attributes:
        frames: environment steps taken so far, all episodes of training counted.
        iteration: iterations done.
    """

    frames: int
    iteration: int

    @abstractmethod
    def iterate(self) -> dict[str, float]:
        """Do one iteration and return its metrics, named `train/...`."""

    @abstractmethod
    def module(self) -> nn.Module:
        """Return the present policy: a torch module from raw observation to action."""

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """Return all that the next iterations depend on: tensors, numbers and names."""

    @abstractmethod
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go back to a state: iterations then equal those of the run that it is from."""
