"""The interface of scores.

    numbers = score(real, simulated, turn)      # (...), (n, ...) -> (n,)

`aligned` says whether it compares row by row, or samples of transitions; see the providers. `rows`
is the horizon of an aligned score: rows after each measured state, or None for whole windows.
"""

from abc import ABC, abstractmethod
from typing import Any

import numpy as np


class Score(ABC):
    """Base class of scores; one whose calls depend on each other has a state."""

    aligned: bool
    rows: int | None  # its horizon; see the module's docstring

    @abstractmethod
    def __call__(self, real: np.ndarray, simulated: np.ndarray, turn: int = 0) -> np.ndarray:
        """Return how far each of n simulations is from what was measured, (n,).

        Args:
            real: as the provider's `real`.
            simulated: n of them, (n, ...).
            turn: the number of the call, from 0; what is random follows from it.
        """

    def begin(self, observation: int, seed: int) -> None:  # noqa: B027 - most need neither
        """Forget everything; transitions then have observations of this size."""

    def state(self) -> dict[str, Any]:
        """Return the state of the score, as arrays by name; {} for a stateless score."""
        return {}

    def load(self, state: dict[str, Any]) -> None:  # noqa: B027 - most have none
        """Go back to a state."""
