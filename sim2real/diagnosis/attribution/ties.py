"""Which contenders do as well as another, and which of equals is taken.

    behind = as_good(search, contender.error, reference, rest)      # None: surely worse
    best = measured(search, own, raced, rest)       # None: nothing better

Held-out errors of motions cannot part a low gain from more damping where a servo is never at its
limit. A channel may: the duty that a servo reports, over the error that it saw, is its gain,
whatever rubs. Such a measurement says nothing of what else is missing, so that it takes part in no
fit and adds no cause. It decides where replays do not, once all other causes are known.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol

import numpy as np

from envs.effects import EFFECTS
from envs.plant import Fixed
from sim2real.diagnosis.attribution.contenders import Contender
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.data.score import Blocks
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import Search

# the effect that a finding of preflight measures
MEASURED = {"control_law": "position_gain", "drift": "clock_drift"}
Witnessed = frozenset[tuple[str, str | None]]  # effects by name and place


class Judged(Protocol):
    """What a tie is told from: a search.

    Attributes:
        problem: all windows.
        blocks: of these.
        floor: noise floor, in the units of errors.
        settings: of the search.
        witnessed: effects that channels measured.
    """

    problem: Problem
    blocks: Blocks
    floor: float
    settings: Search
    witnessed: Witnessed


def witnesses(findings: Iterable[Finding], fixed: Sequence[Fixed]) -> Witnessed:
    """Return the effects that preflight measured, but those that are in the model already.

    A finding compares a channel with the model alone: what is known besides may be just that.

    Args:
        findings: of preflight.
        fixed: effects that are in the model.
    """
    known = {(effect.name, effect.where) for effect, _ in fixed}
    names = [(MEASURED[one.check], one.where) for one in findings if one.check in MEASURED]
    found = {(n, None if EFFECTS[n].place == "robot" else where) for n, where in names}
    return frozenset(e for e in found if e not in known and (e[0], None) not in known)


def as_good(
    search: Judged, error: np.ndarray, reference: np.ndarray, rest: np.ndarray
) -> float | None:
    """Return by how much more errors leave than a reference that they do as well as; else None.

    Args:
        search: whose blocks and limits.
        error: held out, (W, T, M).
        reference: of who they are compared with.
        rest: without either.
    """
    blocks, limits = search.blocks, search.problem.data.settings.causes
    worth = max(blocks.rms(rest) - blocks.rms(reference), 0.0)
    floors = search.settings.worth_floors * search.floor
    near = max(limits.equal_share * worth, min(floors, limits.equal_worth * worth))
    low, _ = blocks.gain(error, reference)
    behind = blocks.rms(error) - blocks.rms(reference)
    unsure = low <= 0 and behind < limits.equal_unsure * worth
    return behind if behind < near or unsure else None


def measured(
    search: Judged, own: Contender, raced: Sequence[Contender], rest: np.ndarray
) -> Contender | None:
    """Return who should have a cause's place, since it does as well and a channel measured it.

    A cause that is measured itself keeps its place against what does no better. Another one takes
    it if it did as well as the cause in one race, in which both took as few steps.

    Args:
        search: whose witnesses, blocks and limits.
        own: the cause, settled.
        raced: contenders for its place, itself among them where it raced.
        rest: held-out errors without any of them, (W, T, M).
    """
    if _place(own) in search.witnessed:
        best = min([own, *raced], key=lambda one: search.blocks.rms(one.error))
        return own if as_good(search, own.error, best.error, rest) is not None else None
    label = own.candidate.label
    reference = next((one.error for one in raced if one.candidate.label == label), own.error)
    for one in raced:
        if _place(one) in search.witnessed:
            return one if as_good(search, one.error, reference, rest) is not None else None
    return None


def _place(one: Contender) -> tuple[str, str | None]:
    """Return the name and the place of what a contender adds."""
    return one.candidate.name, one.candidate.effect.where
