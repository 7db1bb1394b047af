"""As few values as the logs ask for: what is shared by all joints first, and each value paid for.

    found = simplified(search, found)           # after a search

A search that adds effects one by one, and one by families even more so, ends with values that the
robot does not have. Four things mend that, all on held-out errors:

* an effect of all joints takes the place of one joint's, where the other joints' errors pay for it;
* one value for all joints takes the place of one a joint, unless these surely do better;
* each value is taken out, the cheapest first, and stays out unless it pays for itself;
* so does one whose interval holds neutral (`conclude`).

The price of a value is told in `price`.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from sim2real.diagnosis.attribution.attribute import Found, Search
from sim2real.diagnosis.attribution.candidates import Candidate, in_the_way
from sim2real.diagnosis.attribution.fit import Fit, columns, refine
from sim2real.diagnosis.attribution.price import pays, worth
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.attribution.quantify import without

PAIR = 2
SIMPLIFYING = 0.85  # share of the work that is done then


def simplified(search: Search, found: Found) -> Found:
    """Return what was found with fewer values, where the further ones do not pay."""
    found = _everywhere(search, found)
    if len(found.fit.members) < 2:
        return found
    search.say("leaving out what is not needed", SIMPLIFYING)
    found = _wide(search, found)
    found = _merged(search, found)
    found = _eliminated(search, found)
    search.keep(found, found.fit, found.error)
    return found


def _everywhere(search: Search, found: Found) -> Found:
    """Return what was found with effects of all joints in the place of those of a single one.

    Both are one value. In a race the joint that is furthest off decides alone, even where all that
    is left there is a wrong law; here each joint's errors count by its own price.
    """
    shared = {_kind(option): option for option in search.options if option.shared}
    for kind in dict.fromkeys(map(_kind, found.fit.members)):
        own = [i for i, member in enumerate(found.fit.members) if _kind(member) == kind]
        one = shared.get(kind)
        if one is None or len(own) > 1 or found.fit.members[own[0]].joint is None:
            continue
        others = [m for i, m in enumerate(found.fit.members) if i not in own]
        if any(in_the_way(one.effect, other.effect) for other in others):
            continue
        members = tuple(one if i in own else m for i, m in enumerate(found.fit.members))
        fit = replace(found.fit, members=members)  # with the value of the joint
        error = search.problem.held_out(members, fit.values)
        if worth(search, found.error, error) < 1:
            continue
        anew = _as_one(search, found.fit, own, one)
        fits = [(fit, error), (anew, search.problem.held_out(anew.members, anew.values))]
        fit, error = min(fits, key=lambda made: search.blocks.rms(made[1]))
        if worth(search, found.error, error) >= 1:
            rivals = {
                k: v for k, v in found.rivals.items() if k not in _labels(found.fit.members, own)
            }
            found = _with(replace(found, rivals=rivals), fit, error, one.label)
            search.keep(found, fit, error)
    return found


def _wide(search: Search, found: Found) -> Found:
    """Return what effects of the whole robot alone come to, unless places surely do better.

    They are sought where several joints have causes of their own, no more of them than there are of
    these, and only as long as they promise to get anywhere near.
    """
    joints = {member.joint for member in found.fit.members} - {None}
    options = [option for option in search.options if option.effect.where is None]
    if len(joints) < 2 or not any(option.shared for option in options):
        return found
    wide = copy(search)
    wide.options, wide.responses, wide.raced = options, [], {}
    wide.enough = search.problem.data.settings.parsimony.reach * _closed(search, found)
    wide.first = search.screened(search.screening, search.none, options)
    if len(found.fit.members) <= PAIR and not _promise(wide):
        return found
    with search.work.during("whole robot"):
        few = wide.ahead(len(found.fit.members))
        if _closed(search, few) >= wide.enough:
            wide.back(few)
    more = len(found.fit.members) - len(few.fit.members)
    better = search.blocks.rms(few.error) <= search.blocks.rms(found.error)
    saves = more > 0 and not pays(search, few.error, found.error, more)
    if not few.fit.members or not (better or saves):
        return found
    return replace(few, rivals={}, guesses=found.guesses, singles=found.singles)  # all may race


def _promise(wide: Search) -> bool:
    """Return whether one or two effects promise enough, by the first screening."""
    best = [made[0].gain for made in (wide.first.guesses, wide.couples()) if made]
    return any(wide.reaches(wide.before, gain) for gain in best)


def _closed(search: Search, found: Found) -> float:
    return search.closed(search.blocks.rms(found.error))


def _merged(search: Search, found: Found) -> Found:
    """Return what was found with one value for all places of a kind, where that does as well."""
    shared = {_kind(option): option for option in search.options if option.shared}
    for kind in dict.fromkeys(map(_kind, found.fit.members)):
        members = found.fit.members
        own = [i for i, member in enumerate(members) if _kind(member) == kind]
        one = shared.get(kind)
        if one is None or len(own) < 2:
            continue
        fit = _as_one(search, found.fit, own, one)
        error = search.problem.held_out(fit.members, fit.values)
        if not pays(search, error, found.error, len(own) - 1):
            rivals = {k: v for k, v in found.rivals.items() if k not in _labels(members, own)}
            found = _with(replace(found, rivals=rivals), fit, error, one.label)
    return found


def _kind(option: Candidate) -> str:
    """Return an effect's name and variant, without its place."""
    return f"{option.name} {option.effect.variant}"


def _labels(members: Sequence[Candidate], numbers: Sequence[int]) -> set[str]:
    return {members[i].label for i in numbers}


def _as_one(search: Search, fit: Fit, own: Sequence[int], one: Candidate) -> Fit:
    """Return a fit of one value in the place of several, from each of theirs and their mean."""
    rest = without(fit, [i for i in range(len(fit.members)) if i not in own])
    places = columns(fit.members)
    values = np.stack([fit.values[:, places[i]] for i in own])  # (k, 2, p)
    starts = np.concatenate([values.mean(axis=0, keepdims=True), values])
    known = np.repeat(rest.values[None], len(starts), axis=0)
    return refine(
        search.settling,
        (*rest.members, one),
        np.concatenate([known, starts], axis=2),
        search.settings.final_rounds,
    )


def _eliminated(search: Search, found: Found) -> Found:
    """Return what was found without the members that do not pay, the cheapest tried first.

    A member is cheap if little is lost without it as the others are. It is judged once they have
    been fitted again, and the look ends where several in a row have paid.
    """
    every = range(len(found.fit.members))
    rests = [without(found.fit, [k for k in every if k != i]) for i in every]
    losses = [worth(search, e, found.error) for e in search.problem.held_out_each(rests)]
    order, paid = [found.fit.members[i] for i in np.argsort(losses)], 0
    for member in order:
        if paid > search.problem.data.settings.parsimony.kept or len(found.fit.members) < 2:
            break
        tried = dropped(search, found, [found.fit.members.index(member)])
        paid = paid + 1 if pays(search, tried.error, found.error) else 0
        found = found if paid else tried
    return found


def dropped(search: Search, found: Found, numbers: Sequence[int]) -> Found:
    """Return what was found without some members, the others fitted anew."""
    members, gone = found.fit.members, _labels(found.fit.members, numbers)
    kept = [i for i in range(len(members)) if i not in numbers]
    if len(numbers) == 1 and len(kept) <= search.settings.causes_max:
        part, error, _ = search.rest(found.fit, members[numbers[0]])
    else:
        part = without(found.fit, kept)
        if kept:
            rounds = search.settings.rest_rounds
            part = refine(_judging(search, part), part.members, part.values[None], rounds)
        error = search.problem.held_out(part.members, part.values)
    rivals = {label: own for label, own in found.rivals.items() if label not in gone}
    return _with(replace(found, rivals=rivals), part, error, "fewer values")


def _judging(search: Search, fit: Fit) -> Problem:
    """Return the windows that many values are fitted to: all joints have to move there."""
    return search.settling if len(fit.members) > search.settings.causes_max else search.fitting


def _with(found: Found, fit: Fit, error: np.ndarray, label: str) -> Found:
    """Return what was found with another fit, which becomes the last step."""
    return replace(found, fit=fit, error=error, steps=[*found.steps, (label, error)])


def neutral(fit: Fit, spans: np.ndarray) -> list[int]:
    """Return the members whose sizes' intervals (P, 2) all hold the neutral value."""
    found = []
    for number, (member, place) in enumerate(zip(fit.members, columns(fit.members), strict=True)):
        sizes = slice(place.start, place.stop - len(member.effect.free))
        none = member.neutral[: sizes.stop - sizes.start]
        low, high = spans[sizes].T
        if ((low <= none) & (none <= high)).all():
            found.append(number)
    return found
