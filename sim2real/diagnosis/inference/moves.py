"""From one hypothesis to its neighbours: one more change, one fewer.

starts = add_members(best, pool)              # from where each begins
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim2real.diagnosis.attribution.candidates import in_the_way
from sim2real.diagnosis.inference.fit import Fit, Start
from sim2real.diagnosis.inference.hypotheses import Hypothesis, Member
from sim2real.diagnosis.inference.log_changes import LogChange
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


def add_members(best: Fit, pool: Sequence[Start]) -> list[Start]:
    """Return the best with one more change each, from where each begins."""
    found = []
    for hypothesis, points in pool:
        (member,) = hypothesis.members
        if all(_compatible(member, other) for other in best.hypothesis.members):
            found.append(_joined(best, member, points))
    return found


def _compatible(one: Member, other: Member) -> bool:
    """Return whether two changes can be there at once."""
    if one.label == other.label:
        return False
    if isinstance(one, LogChange) or isinstance(other, LogChange):
        return True
    return not in_the_way(one.effect, other.effect)


def _joined(best: Fit, member: Member, points: np.ndarray) -> Start:
    """Return a fit with one more member, at points (K, P) of it."""
    hypothesis = Hypothesis.of([*best.hypothesis.members, member])
    values = np.empty((len(points), FOLDS, len(hypothesis.low)))
    pairs = zip(best.hypothesis.members, best.hypothesis.columns, strict=True)
    own = {m.label: best.values[:, column] for m, column in pairs}
    for one, column in zip(hypothesis.members, hypothesis.columns, strict=True):
        values[..., column] = points[:, None] if one is member else own[one.label]
    return Start(hypothesis, values)


def without(fit: Fit, place: int) -> Start:
    """Return a fit without one member, the others at their values."""
    kept = np.ones(fit.values.shape[1], bool)
    kept[fit.hypothesis.columns[place]] = False
    return Start(fit.hypothesis.without(place), fit.values[None][..., kept])


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
