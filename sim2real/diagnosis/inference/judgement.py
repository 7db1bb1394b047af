"""What the judge says of a gap, and what an explanation leaves of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sim2real.diagnosis.inference.fit import Fit
from sim2real.diagnosis.inference.pushes import Pushed
from sim2real.diagnosis.inference.score import Gain
from sim2real.diagnosis.schema import Verdict

if TYPE_CHECKING:
    from sim2real.diagnosis.inference.judge import Judge


@dataclass(frozen=True)
class Judgement:
    """What the judge says.

    Args:
        verdict: see `decision`.
        best: the explanation; the model as given where there is none.
        given: the model as given.
        nulls: the null explanations by name.
        rivals: other explanations that were fitted to the end, the best first.
        left: what a free discrepancy still gains over one of a count [nats a reading].
        pushes: torques that act for a moment and hold most of what is left.
        probability: of the best and of each rival, (1 + n,).
        unknown: probability of a law that is not in the vocabulary.
        judge: who said so.
    """

    verdict: Verdict
    best: Fit
    given: Fit
    nulls: dict[str, Fit]
    rivals: tuple[Fit, ...]
    left: Gain
    pushes: tuple[Pushed, ...]
    probability: np.ndarray
    unknown: float
    judge: Judge


class Left(NamedTuple):
    """What a free discrepancy gains over one of at most a count."""

    gain: Gain  # nats a reading, but for a few windows: contact and sticking make errors jump
    whole: float  # upper bound with those windows
