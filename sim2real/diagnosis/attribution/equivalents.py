"""Effects that may stand in a cause's place, also where none raced for it.

    found = with_rivals(search, found)           # found.rivals has every cause
    inseparable(search, cause, other)            # no recording of this kind can part them

A race leaves few, and values that were found together (one kind of effect at every joint) never
raced. So each cause races for its place once; and every effect whose change of the simulation, as
it was screened, points where the cause's does is fitted in its place as well: what the two do to
the logs is then all but collinear, whatever their names. So is what makes the same equations of
motion as the cause, wherever it was screened; and what passes for the cause in these logs: an
eccentric encoder for a shifted one, where the joint turns little. Held-out errors judge them
(`alike`).

Two kinds of effects are inseparable whatever is recorded of commands and positions: delays of the
command and of the measurement, unless readings have stamps of their own; and effects that make the
same equations of motion with some values, such as the supply and the strength of motors without
damping, or a rotor's inertia and that of a link which turns about nothing but its axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from envs.effects.base import PLAIN
from sim2real.diagnosis.attribution.attribute import Contender, Found, Search
from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.fit import Fit, columns, refine
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.attribution.quantify import without
from sim2real.diagnosis.attribution.same_dynamics import Pair, same_dynamics, twins
from sim2real.diagnosis.attribution.screen import Response
from sim2real.diagnosis.attribution.suspects import meets
from sim2real.diagnosis.attribution.ties import as_good
from sim2real.diagnosis.settings import TINY_SQUARE

DELAYS = ("command_delay", "observation_delay")


def with_rivals(search: Search, found: Found) -> Found:
    """Return what was found with contenders for each cause's place; `found.rivals` has them."""
    few = len(found.fit.members) <= search.problem.data.settings.verdict.causes_max
    rivals = dict(found.rivals)
    for number, member in enumerate(found.fit.members):
        raced = list(rivals.get(member.label, []))
        rest, own = _rest(found.fit, number), Contender(member, found.fit, found.error)
        if not raced and few:
            raced = [own, *_others(search.place_of(own).contenders, member)]
        more: list[Contender] = []
        if found.seen is None:
            known = [c.candidate.label for c in raced]
            same = _twins(search, found.fit, number, known)
            more = [_instead(search, found, rest, option, [values]) for option, values in same]
            known += [option.label for option, _ in same]
            alike = _look_alikes(search, found.fit, number, known)
            more += [_like(search, found, rest, response) for response in alike]
            passing = _stand_ins(search, [own, *raced, *more])
            more += [_instead(search, found, rest, o, o.probes) for o in passing]
        if raced or more:
            settled = Contender(member, found.fit, found.on(found.error), settled=True)
            rivals[member.label] = [*raced, settled, *more]
    return replace(found, rivals=rivals)


def _others(contenders: Sequence[Contender], member: Candidate) -> list[Contender]:
    return [c for c in contenders if c.candidate.label != member.label]


def _rest(fit: Fit, number: int) -> Fit:
    """Return the other causes with their values."""
    return without(fit, [i for i in range(len(fit.members)) if i != number])


def _twins(search: Search, fit: Fit, number: int, known: Sequence[str]) -> list[Pair]:
    """Return what moves the robot as a cause does, with the values that do so.

    Screening may have probed it where it does much less, so that no change points there.
    """
    member, data = fit.members[number], search.problem.data
    if member.group != PLAIN:
        return []
    own = member, fit.values.mean(axis=0)[columns(fit.members)[number]]
    taken = {(m.name, m.effect.where) for m in fit.members}
    others = (
        option
        for option in search.options
        if option.group == PLAIN
        and option.label not in known
        and (option.name, option.effect.where) not in taken
        and (None in (option.joint, member.joint) or option.joint == member.joint)
    )
    return list(twins(data.specs[0], own, others, data.settings.causes))


def _look_alikes(search: Search, fit: Fit, number: int, known: Sequence[str]) -> list[Response]:
    """Return screened responses that point where a cause's change of the simulation points.

    The nearest of each effect, the nearest effects first; both delays, whatever they point at.
    """
    member, limits = fit.members[number], search.problem.data.settings.causes
    problem = search.screening
    change, unit = _change(problem, fit, number)
    best: dict[str, tuple[float, Response]] = {}
    taken = {(m.name, m.effect.where) for m in fit.members}
    for response in search.responses:
        other = response.candidate
        if other.label in known or (other.name, other.effect.where) in taken:
            continue
        if not meets(other, member):
            continue
        near = _cosine(change, _straight(problem, response.change, unit))
        if {other.name, member.name} == set(DELAYS):
            near = 1.0
        if near >= limits.look_alike and near > best.get(other.label, (0.0,))[0]:
            best[other.label] = near, response
    ranked = sorted(best.values(), key=lambda pair: -pair[0])
    return [response for _, response in ranked[: limits.look_alikes_max]]


def _change(problem: Problem, fit: Fit, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return what a cause changes, the clock's part taken out, and the clock's direction."""
    values = fit.values.copy()
    values[:, columns(fit.members)[number]] = fit.members[number].neutral
    error, slope = problem.errors(fit.members, np.stack([fit.values, values]))
    unit = slope[1].ravel() / max(float(np.linalg.norm(slope[1])), TINY_SQUARE)
    return _straight(problem, error[0] - error[1], unit), unit


def _straight(problem: Problem, change: np.ndarray, unit: np.ndarray) -> np.ndarray:
    """Return a change (W, T, M), flat, without its part along the clock's direction."""
    flat = change.ravel()
    return flat - (flat @ unit) * unit


def _cosine(one: np.ndarray, other: np.ndarray) -> float:
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / max(size, TINY_SQUARE)


def _stand_ins(search: Search, contenders: Sequence[Contender]) -> list[Candidate]:
    """Return what passes for a cause in these logs, or for what does as well.

    Args:
        search: after its run.
        contenders: for the cause's place, itself the first one.
    """
    error, base = contenders[0].error, search.base
    good = [c for c in contenders if as_good(search, c.error, error, base) is not None]
    places = {(one.candidate.name, one.candidate.place) for one in good}
    return [option for option in search.stand_ins if (option.passes_for, option.place) in places]


def _like(search: Search, found: Found, rest: Fit, response: Response) -> Contender:
    """Return what acts like a cause, as it was screened, fitted in its place."""
    option = response.candidate
    starts = [option.towards(response.probe, size) for size in search.settings.spread]
    return _instead(search, found, rest, option, starts)


def _instead(
    search: Search,
    found: Found,
    rest: Fit,
    option: Candidate,
    starts: Sequence[np.ndarray] | np.ndarray,
) -> Contender:
    """Return an effect fitted in the place of a cause, beside the others, from starts (P,)."""
    folds = len(rest.values)
    values = [np.concatenate([rest.values, np.tile(s, (folds, 1))], axis=1) for s in starts]
    members = (*rest.members, option)
    fit = refine(search.fitting, members, np.array(values), search.settings.settled_rounds)
    error = search.problem.held_out(members, fit.values)
    return Contender(option, fit, found.on(error), settled=True)


def value_of(contender: Contender) -> np.ndarray:
    """Return the values of what a contender adds to the others, (2, P)."""
    members = contender.fit.members
    return contender.fit.values[:, columns(members)[members.index(contender.candidate)]]


def explanations(fit: Fit, sets: Sequence[Sequence[Contender]]) -> tuple[tuple[str, Fit], ...]:
    """Return labels and fits of all that explains the logs alike; () where nothing else does.

    Args:
        fit: the causes.
        sets: for each of them, what other recordings may tell from it.
    """
    labels = {number: fit.members[number].label for number, own in enumerate(sets) if own}
    found = [(" with ".join(labels.values()), fit)]
    for number in labels:
        rest = _rest(fit, number)
        for one in sets[number]:
            words = " with ".join({**labels, number: one.candidate.label}.values())
            values = np.concatenate([rest.values, value_of(one)], axis=1)
            found.append((words, Fit((*rest.members, one.candidate), values, rest.cost)))
    return tuple(found) if labels else ()


def inseparable(search: Search, one: Pair, other: Pair) -> bool:
    """Return whether no recording of commands and positions can part two effects."""
    if {one[0].name, other[0].name} == set(DELAYS):
        logs, joints = search.problem.data.logs, search.problem.data.joints
        return not all(f"stamp.{joint.name}" in log.columns for log in logs for joint in joints)
    if any(candidate.group != PLAIN for candidate, _ in (one, other)):
        return False
    data = search.problem.data
    return same_dynamics(data.specs[0], one, other, data.settings.causes)
