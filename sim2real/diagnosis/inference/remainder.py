"""What is left of a gap: at which joint, and when.

describe_remainder(judgement)        # "74 % of it at elbow; 80 % within 3.1 to 3.4 s of episode 1"
"""

from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.inference.events import PART
from sim2real.diagnosis.inference.judge import Judgement

STRETCHES = (0.25, 0.5, 1.0, 2.0, 4.0)  # s: lengths of such stretches


class Stretch(NamedTuple):
    """A stretch of an episode, and what part of what is left it holds."""

    log: int
    episode: int
    start: float  # s
    end: float
    part: float


def find_stretch(judgement: Judgement, left: np.ndarray) -> Stretch | None:
    """Return the shortest stretch that holds most of what is left; None where it is everywhere.

    What is left of each reading is `left`, (W, N, M).
    """
    judge = judgement.judge
    rows = left.sum(axis=2)
    total = float(rows.sum())
    if not total:
        return None
    data = judge.data
    clock = np.array(
        [
            data.logs[w.log].time[w.start] + own
            for w, own in zip(data.windows, judge.replayer.times, strict=True)
        ]
    )
    pairs = zip(clock, judge.replayer.used, strict=True)
    span = sum(float(np.ptp(own[used])) for own, used in pairs)
    for length in STRETCHES:
        if length > span * (1 - PART):
            return None
        best = Stretch(0, 0, 0.0, 0.0, 0.0)
        for window, own, part in zip(data.windows, clock, rows, strict=True):
            for start in own:
                inside = (own >= start) & (own <= start + length)
                found = float(part[inside].sum()) / total
                if found > best.part:
                    end = float(own[inside][-1])
                    best = Stretch(window.log, window.episode, float(start), end, found)
        if best.part >= PART:
            return best
    return None


def describe_remainder(judgement: Judgement) -> str:
    """Return what is left in words: joint, time where it is not everywhere, what would explain it.

    That is an excluded effect, or parameters of the model that are off by more than usual.
    """
    text = _describe_errors(judgement)
    left, settings = judgement.judge.left(judgement.best), judgement.judge.settings
    if left._replace(usual=True).is_nothing(settings) and not left.usual:
        text += "; parameters of the model that are off by more than usual would explain it"
    if judgement.imitators:
        best = max(judgement.imitators, key=lambda fit: fit.total)
        text += f"; with an effect that was excluded, {best.label} predicts as well"
    return text


def _describe_errors(judgement: Judgement) -> str:
    left, data = judgement.judge.excess(judgement.best.held), judgement.judge.data
    by_joint = left.sum(axis=(0, 1))
    if not by_joint.sum():
        return "less than a count of every encoder, for longer than noise lasts"
    worst = int(by_joint.argmax())
    text = f"{by_joint[worst] / by_joint.sum():.0%} of it at {data.joints[worst].name}"
    stretch = find_stretch(judgement, left)
    if stretch is not None:
        text += (
            f", {stretch.part:.0%} at {stretch.start:.2f} to {stretch.end:.2f} s of episode "
            f"{stretch.episode}"
        )
    return text
