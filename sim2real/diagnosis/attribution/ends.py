"""Shares at an end of their range, where being in between does not pay.

    found = at_ends(search, found)              # after a search

A share is a further scalar of an effect, such as the punch of a dead zone. At either end it makes a
law of its own; in between it trades with the effect's size, so that both are a little off. At an
end it is no value any more: it is part of the law, and the size alone has an interval.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np

from envs.effects import Effect
from sim2real.diagnosis.attribution.attribute import Found, Search
from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.fit import columns, refine
from sim2real.diagnosis.attribution.price import worth


def at_ends(search: Search, found: Found) -> Found:
    """Return what was found with each share at its nearer end, unless the middle is worth it.

    Args:
        search: after its run.
        found: what it found.
    """
    for label in [member.label for member in found.fit.members]:
        for name in shares(next(m for m in found.fit.members if m.label == label).effect):
            found = _ended(search, found, label, name)
    return found


def shares(effect: Effect) -> list[str]:
    """Return the free extras of an effect that are shares: without a unit, within two ends."""
    return [
        extra.name
        for extra in effect.extras
        if extra.name in effect.free
        and extra.unit == ""
        and extra.fit == (extra.low, extra.high)
        and np.isfinite(extra.high)
    ]


def _ended(search: Search, found: Found, label: str, name: str) -> Found:
    members = list(found.fit.members)
    number = next(i for i, member in enumerate(members) if member.label == label)
    member, own = members[number], columns(members)[number]
    own_free = own.stop - len(member.effect.free) + member.effect.free.index(name)
    low, high = member.low[own_free - own.start], member.high[own_free - own.start]
    end = float(low if found.fit.mean[own_free] - low <= high - found.fit.mean[own_free] else high)
    members[number] = ended(member, name, end)
    start = np.delete(found.fit.values, own_free, axis=1)
    fit = refine(search.settling, members, start[None], search.settings.rest_rounds)
    error = search.problem.held_out(fit.members, fit.values)
    if worth(search, error, found.error) > search.problem.data.settings.parsimony.share_kept:
        return found
    search.keep(found, fit, error)
    return found


def ended(member: Candidate, name: str, end: float) -> Candidate:
    """Return a candidate with one of its free extras held at a value."""
    effect = copy(member.effect)
    place = len(member.neutral) - len(effect.free) + effect.free.index(name)
    effect.free = tuple(free for free in effect.free if free != name)
    effect.extra = {**effect.extra, name: end}
    less = {
        key: np.delete(getattr(member, key), place, axis=-1)
        for key in ("probes", "neutral", "low", "high")
    }
    return replace(member, effect=effect, **less)
