"""From one hypothesis to its neighbours: more changes, one fewer.

start = join_members(best, (member,), member.probes)         # from where a fit begins
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim2real.diagnosis.inference.candidates import in_the_way
from sim2real.diagnosis.inference.fit import Fit, Start
from sim2real.diagnosis.inference.hypotheses import Hypothesis, Member
from sim2real.diagnosis.inference.log_change import LogChange
from sim2real.diagnosis.inference.score import FOLDS


def make_start(member: Member) -> Start:
    """Return a change by itself, at its probes."""
    return Start(Hypothesis((member,)), member.probes)


def rank_fits(fits: Sequence[Fit]) -> list[Fit]:
    """Return fits, the best first."""
    return sorted(fits, key=lambda fit: -fit.total)


def restart(fit: Fit) -> Start:
    """Return a fit as a start."""
    return Start(fit.hypothesis, fit.values[None])


def are_compatible(hypothesis: Hypothesis, member: Member) -> bool:
    """Return whether a change can be combined with those of a hypothesis."""
    return all(_compatible(member, other) for other in hypothesis.members)


def _compatible(one: Member, other: Member) -> bool:
    if one.label == other.label:
        return False
    if isinstance(one, LogChange) or isinstance(other, LogChange):
        return True
    return not in_the_way(one.effect, other.effect)


def join_members(base: Fit, members: Sequence[Member], points: np.ndarray) -> Start:
    """Return a fit with more members, at points (K, P) of theirs, one after the other."""
    ends = np.cumsum([len(m.neutral) for m in members], dtype=int)
    places = {
        m.label: slice(end - len(m.neutral), end) for m, end in zip(members, ends, strict=True)
    }
    hypothesis = Hypothesis.of([*base.hypothesis.members, *members])
    values = np.empty((len(points), FOLDS, len(hypothesis.low)))
    pairs = zip(base.hypothesis.members, base.hypothesis.columns, strict=True)
    own = {m.label: base.values[:, column] for m, column in pairs}
    for member, column in zip(hypothesis.members, hypothesis.columns, strict=True):
        new = places.get(member.label)
        values[..., column] = own[member.label] if new is None else points[:, None, new]
    return Start(hypothesis, values)


def without(fit: Fit, place: int) -> Start:
    """Return a fit without one member, the others at their values."""
    kept = np.ones(fit.values.shape[1], bool)
    kept[fit.hypothesis.columns[place]] = False
    return Start(fit.hypothesis.without(place), fit.values[None][..., kept])


def drop_member(fit: Fit, place: int) -> Fit:
    """Return a fit without one member, as what others are joined to; its errors stay."""
    start = without(fit, place)
    return replace(fit, hypothesis=start.hypothesis, values=start.points[0])


def is_part(one: Hypothesis, other: Hypothesis) -> bool:
    """Return whether all members of a hypothesis are among those of another."""
    labels = {member.label for member in other.members}
    return all(member.label in labels for member in one.members)


def pick_distinct(fits: Sequence[Fit], most: int) -> list[Fit]:
    """Return the first fits of each label, at most so many."""
    found: dict[str, Fit] = {}
    for fit in fits:
        found.setdefault(fit.label, fit)
    return list(found.values())[:most]
