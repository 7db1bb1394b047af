"""The interface of scores.

    numbers = score(real, simulated, turn)      # (...), (n, ...) -> (n,)

`aligned` says whether it compares row by row, or samples of transitions; see the providers. `rows`
is the horizon of an aligned score: rows after each measured state, or None for whole windows.
"""

from typing import Any, Protocol

import numpy as np


class Score(Protocol):
    """Base class of scores."""

    aligned: bool

    @property
    def rows(self) -> int | None:
        """Its horizon in rows; see the module's docstring."""
        ...

    def __call__(self, real: np.ndarray, simulated: np.ndarray, turn: int = 0) -> np.ndarray:
        """Return how far each of n simulations is from what was measured, (n,).

        Args:
            real: as the provider's `real`.
            simulated: n of them, (n, ...).
            turn: the number of the call, from 0; what is random follows from it.
        """
        ...

    def state(self) -> dict[str, Any]:
        """Return the state of the score, as arrays by name; {} for a stateless score."""
        ...

    def load(self, state: dict[str, Any]) -> None:
        """Go back to a state."""
        ...


class StatelessScore:
    """A score whose calls do not depend on each other."""

    def state(self) -> dict[str, Any]:
        """Return {}."""
        return {}

    def load(self, state: dict[str, Any]) -> None:
        """Do nothing."""
