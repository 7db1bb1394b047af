"""From one hypothesis to its neighbours: more changes, one fewer.

start = join_members(best, (member,), member.probes)         # from where a fit begins
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from sim2real.diagnosis.inference.candidates import Candidate, in_the_way
from sim2real.diagnosis.inference.fit import Fit, Start
from sim2real.diagnosis.inference.hypotheses import Hypothesis, Member
from sim2real.diagnosis.inference.log_change import LogChange
from sim2real.diagnosis.inference.score import FOLDS
from sim2real.diagnosis.inference.untied import Untied, untie

LATER = (0.05, 0.2)  # shares of the range of what is fitted later: it is small, and 0 is no slope
ALIKE = ("unit", "place", "where", "variant", "how")  # what laws of one kind have in common


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
    if one.law == other.law:
        return False
    if isinstance(one, LogChange) and isinstance(other, LogChange):
        return not _is_made_twice(one, other)
    if isinstance(one, LogChange) or isinstance(other, LogChange):
        return True
    if one.name == other.name and (isinstance(one, Untied) or isinstance(other, Untied)):
        return False
    return not in_the_way(one.effect, other.effect)


def _is_made_twice(one: LogChange, other: LogChange) -> bool:
    """Return whether two mistakes are of one kind and in one column: then they are one."""
    meet = one.place == other.place or None in (one.place, other.place)
    return one.name == other.name and meet and not set(one.columns).isdisjoint(other.columns)


def join_members(base: Fit, members: Sequence[Member], points: np.ndarray) -> Start:
    """Return a fit with more members, at points (K, P) of theirs, one after the other."""
    columns = Hypothesis(tuple(members)).columns
    places = {m.label: column for m, column in zip(members, columns, strict=True)}
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


def _exchange(fit: Fit, place: int, member: Member, point: np.ndarray) -> Start:
    """Return a fit with another member, at a point (P,) of its own, in the place of one."""
    rest = without(fit, place)
    base = replace(fit, hypothesis=rest.hypothesis, values=rest.points[0])
    return join_members(base, (member,), point[None])


def list_simpler(fit: Fit, others: Iterable[Member]) -> list[Start]:
    """Return a fit with simpler laws in the place of each member, at the values that they share.

    A simpler law is an effect of the same unit at the same place and side that lacks some of the
    member's further values, as friction without a Stribeck curve does.
    """
    options, found = [one for one in others if isinstance(one, Candidate)], {}
    columns = fit.hypothesis.columns
    for place, (member, column) in enumerate(zip(fit.hypothesis.members, columns, strict=True)):
        if not isinstance(member, Candidate) or isinstance(member, Untied):
            continue
        rest, names = fit.hypothesis.without(place), _names_of(member)
        for other in options:
            if not _is_simpler(other, member) or not are_compatible(rest, other):
                continue
            kept = [names.index(name) for name in _names_of(other)]
            start = _exchange(fit, place, other, other.neutral)
            labels = [one.label for one in start.hypothesis.members]
            own = start.hypothesis.columns[labels.index(other.label)]
            start.points[..., own] = fit.values[:, column][:, kept]
            found[start.hypothesis.label] = start
    return list(found.values())


def _names_of(member: Candidate) -> list[str]:
    """Return the names of a member's values, the first of which is the effect's own."""
    free = list(member.effect.free)
    count = len(member.neutral) - len(free)
    return [*(str(number) for number in range(count)), *free]


def _is_simpler(other: Candidate, member: Candidate) -> bool:
    pairs = ((getattr(one.effect, name) for one in (other, member)) for name in ALIKE)
    same = all(one == two for one, two in pairs)
    return same and set(_names_of(other)) < set(_names_of(member))


def list_untied(fit: Fit, options: Sequence[Candidate]) -> list[Start]:
    """Return a fit with a value for each joint in the place of one for all, a member at a time.

    The options are effects that the robot may have.
    """
    found = []
    for place, column in enumerate(fit.hypothesis.columns):
        more = untie(fit.hypothesis.members[place], options)
        if more is not None:
            point = np.tile(fit.mean[column], len(more.parts))
            found.append(_exchange(fit, place, more, point))
    return found


def list_elaborated(fit: Fit) -> list[Start]:
    """Return a fit with the further values of a member that are fitted later, a member at a time.

    They begin at some shares of what they may be, the others where they are.
    """
    found = []
    for place, column in enumerate(fit.hypothesis.columns):
        member = fit.hypothesis.members[place]
        more = member.elaborated() if isinstance(member, Candidate) else None
        if more is not None:
            count = len(member.neutral)
            ends = more.low[count:], more.high[count:]
            points = [
                np.append(fit.mean[column], ends[0] + s * np.ptp(ends, axis=0)) for s in LATER
            ]
            starts = [_exchange(fit, place, more, point) for point in points]
            found.append(Start(starts[0].hypothesis, np.concatenate([s.points for s in starts])))
    return found


def list_shorter(fit: Fit) -> list[Start]:
    """Return a fit without one of several members; with one value for all joints, not for each."""
    members, columns = fit.hypothesis.members, fit.hypothesis.columns
    found = [without(fit, place) for place in range(len(members)) if len(members) > 1]
    for place, member in enumerate(members):
        if isinstance(member, Untied):
            point = fit.mean[columns[place]].reshape(len(member.parts), -1).mean(axis=0)
            found.append(_exchange(fit, place, member.tied, point))
    return found


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


def pick_unlike(fits: Sequence[Fit]) -> list[Fit]:
    """Return the first fit that mends the log, and the first that leaves it as it is."""
    return list({bool(fit.hypothesis.mended): fit for fit in reversed(fits)}.values())
