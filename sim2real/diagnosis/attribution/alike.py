"""What the logs cannot tell from a cause, and how sure a cause is.

crowd = equals(search, member, rivals, rest, full)
confidence(search, member, crowd, rivals, rest)
"""

from __future__ import annotations

from collections.abc import Sequence, Set

import numpy as np

from sim2real.diagnosis.attribution.attribute import Contender, Search
from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.ties import as_good
from sim2real.diagnosis.settings import TINY_SQUARE, Causes


def equals(
    search: Search,
    member: Candidate,
    rivals: Sequence[Contender],
    rest: np.ndarray,
    full: np.ndarray,
) -> list[Contender]:
    """Return the rivals that do as well as a member on held-out windows, the best first.

    Those that raced are compared with what the member did in that race, those that settled with
    what it does in the end.

    Args:
        search: after its run.
        member: the cause.
        rivals: contenders for its place, itself among them where it raced.
        rest: held-out errors without it, (W, T, M).
        full: with it, in the end.
    """
    raced = (c.error for c in rivals if c.candidate.label == member.label and not c.settled)
    own = {True: full, False: next(raced, full)}
    found: dict[str, tuple[float, Contender]] = {}
    for contender in rivals:
        label, reference = contender.candidate.label, own[contender.settled]
        if label == member.label:
            continue
        behind = as_good(search, contender.error, reference, rest)
        if behind is not None:
            found.setdefault(label, (behind, contender))
    return [contender for _, contender in sorted(found.values(), key=lambda pair: pair[0])]


def confidence(
    search: Search,
    member: Candidate,
    crowd: Sequence[Contender],
    rivals: Sequence[Contender],
    rest: np.ndarray,
) -> float:
    """Return how much speaks for a cause, or an equal of it; `calibrated` makes it a probability.

    How often it wins when blocks are drawn again, less where the next rival is close behind. A
    rival is close where it closes nearly as much and leaves little more. Where it never raced
    against others, nothing is known of that.
    """
    limits = search.problem.data.settings.causes
    good = {member.label, *(c.candidate.label for c in crowd)}
    races = [[c for c in rivals if c.settled == settled] for settled in (False, True)]
    if not any(c.candidate.label in good for c in races[False]):
        wins, margin, excess = limits.unrivalled, 1.0, np.inf
    else:  # where there are no others, the screening has ruled them out
        results = [_race(search, race, good, rest) for race in races]
        wins, margin, excess = (min(column) for column in zip(*results, strict=True))
    far = max(margin / limits.rival_margin, excess / limits.rival_excess, 0.0)
    near = np.exp(-far)
    sure = limits.sure_max * wins * (1 - limits.rival_doubt * near)
    return float(np.clip(sure, limits.confidence_min, limits.confidence_max))


def calibrated(sure: float, closed: float, limits: Causes) -> float:
    """Return the probability that a cause is right: that a known law is, and that it is this one.

    The former from how often others that closed as much were right, a logistic curve over the log
    of what stays open (Platt 1999, "Probabilistic outputs for support vector machines"): laws that
    nobody thought of are followed by a look-alike to eight tenths, hardly one to nine.

    Args:
        sure: of `confidence`, less what else speaks against the cause; in (0, 1).
        closed: share of the gap that all causes close together.
        limits: the curve, and the ends of what is ever said.
    """
    intercept, slope = limits.calibration
    left = 1 - float(np.clip(closed, 0.0, limits.confidence_max))
    known = 1 / (1 + np.exp(-(intercept - slope * np.log(left))))
    return float(np.clip(known * sure, limits.confidence_min, limits.confidence_max))


def _race(
    search: Search, race: Sequence[Contender], good: Set[str], rest: np.ndarray
) -> tuple[float, float, float]:
    """Return how often the good ones of a race win, and their margin.

    The latter of what they close, and of what they leave.
    """
    blocks = search.blocks
    own = [c for c in race if c.candidate.label in good]
    others = [c for c in race if c.candidate.label not in good]
    if not own or not others:
        return 1.0, 1.0, np.inf
    best = np.min([blocks.drawn(c.error) for c in own], axis=0)
    next_best = np.min([blocks.drawn(c.error) for c in others], axis=0)
    left = min(blocks.rms(c.error) for c in own)
    worth = blocks.rms(rest) - left
    gap = min(blocks.rms(c.error) for c in others) - left
    wins = float(np.mean(best < next_best))
    return wins, gap / max(worth, TINY_SQUARE), gap / max(left, TINY_SQUARE)
