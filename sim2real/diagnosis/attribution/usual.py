"""What the small errors of any model make together, and whether a cause stands clear of that.

    usual = Usual(search)
    usual.clear(rest, full)              # 0: no more than they make; 1: far more

No model is right to a few per cent: masses come from a scale, friction and gains from a data sheet.
Together such errors make a gap that no effect causes, and of which one effect can close most. A
cause that leaves something lasting, and closes no more than they would make, may be one of that
kind. It is still named; only less sure.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from envs.effects import EFFECTS
from sim2real.diagnosis.attribution.attribute import Search
from sim2real.diagnosis.attribution.candidates import Candidate, candidate_of
from sim2real.diagnosis.attribution.fit import FOLDS, Ask
from sim2real.diagnosis.attribution.probes import robot_scale
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.settings import TINY

NAMES = ("link_mass", "link_inertia", "coulomb_friction", "viscous_friction", "position_gain")


class Usual:
    """The gap of usual errors, on the windows of a race.

    Args:
        search: after its run.
    """

    def __init__(self, search: Search) -> None:
        self._limits = search.problem.data.settings.causes
        self._problem = search.problem.subset(search.racing.windows)
        error = self._limits.usual_error
        asks = [
            Ask((option,), np.full((1, FOLDS, 1), 1 + sign * error))
            for option, sign in itertools.product(scaled(search.problem.data), (1, -1))
        ]
        errors = [error[0] for error, _ in self._problem.errors_each(asks)]
        halves = [(more - less) / 2 for more, less in zip(errors[::2], errors[1::2], strict=True)]
        self.gap = float(np.sqrt(sum(self._square(half) for half in halves)))

    def _square(self, error: np.ndarray) -> float:
        """Return the mean square of errors of the race's windows."""
        return float((error**2).sum()) / self._problem.rows

    def clear(self, rest: np.ndarray, full: np.ndarray) -> float:
        """Return how clear of usual errors a cause is, from 0 to 1.

        Args:
            rest: errors of all windows without it, (W, T, M).
            full: with it.
        """
        windows = self._problem.windows
        closes = np.sqrt(max(self._square(rest[windows]) - self._square(full[windows]), 0.0))
        times = closes / max(self.gap, TINY)
        return float(np.clip((times - 1) / (self._limits.usual_clear - 1), 0.0, 1.0))


def scaled(data: Data) -> Iterator[Candidate]:
    """Yield what a model has of its own at each place, as a factor of it."""
    scale = robot_scale(data)
    for name in NAMES:
        for place in EFFECTS[name].places(scale):
            arguments = {"where": place, "how": "scale"}
            option = None if place is None else candidate_of(name, arguments, data.specs[0], scale)
            if option is not None:
                yield option
