"""What a search holds in its hands: contenders that raced, and what was found.

contender.candidate, contender.fit, contender.error
found.fit.members, found.rivals
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.promise import Guess


class Contender(NamedTuple):
    """A candidate fitted beside the effects found so far, and its held-out errors.

    One that raced took few steps beside what was then known; one that is `settled` as many as the
    causes, beside all others: only equals are compared with each other.
    """

    candidate: Candidate
    fit: Fit
    error: np.ndarray  # (W, T, M)
    settled: bool = False


class Raced(NamedTuple):
    """A race that was run: beside what, and who was left, the best first."""

    fit: Fit
    error: np.ndarray  # (W, T, M) held out, of that fit
    contenders: list[Contender]


@dataclass
class Found:
    """What attribution came to.

    Args:
        fit: the causes and their values.
        error: held-out errors with all of them, (W, T, M).
        steps: held-out errors after each effect was added, with its label.
        rivals: for each cause, the contenders for its place, the best first.
        guesses: what screening made of every candidate, alone.
        singles: candidates that were fitted alone.
        seen: the rows on which rivals are compared, (W, T, 1); None for all.
    """

    fit: Fit
    error: np.ndarray
    steps: list[tuple[str, np.ndarray]] = field(default_factory=list)
    rivals: dict[str, list[Contender]] = field(default_factory=dict)
    guesses: list[Guess] = field(default_factory=list)
    singles: list[Contender] = field(default_factory=list)
    seen: np.ndarray | None = None

    def on(self, error: np.ndarray) -> np.ndarray:
        """Return errors on the rows on which rivals are compared, zeros elsewhere, (W, T, M)."""
        return error if self.seen is None else np.where(self.seen, error, 0.0)
