"""How far the values of several effects may go.

bounds = Bounds(members)
bounds.clip(values)         # (..., P)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim2real.diagnosis.attribution.candidates import Candidate


class Bounds:
    """Ranges and typical changes of all parameters of some members, (P,) each.

    Args:
        members: the effects, in the order of their parameters.
    """

    def __init__(self, members: Sequence[Candidate]) -> None:
        self.low = np.concatenate([np.zeros(0), *(m.low for m in members)])
        self.high = np.concatenate([np.zeros(0), *(m.high for m in members)])
        self.neutral = np.concatenate([np.zeros(0), *(m.neutral for m in members)])
        self.step = np.concatenate([np.zeros(0), *(m.step for m in members)])

    def clip(self, values: np.ndarray) -> np.ndarray:
        """Return values (..., P) within their ranges."""
        return np.clip(values, self.low, self.high)
