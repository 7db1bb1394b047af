"""A cause in a report: its name, value and share, and what cannot be told from it.

cause, crowd = cause_of(search, weighed, place)
valued(cause, member, values, spans)    # with its value and interval
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim2real.diagnosis.attribution.alike import confidence, equals
from sim2real.diagnosis.attribution.attribute import Contender, Found, Search
from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.equivalents import inseparable, value_of
from sim2real.diagnosis.attribution.fit import columns
from sim2real.diagnosis.attribution.quantify import contradicted
from sim2real.diagnosis.attribution.weigh import Weighed
from sim2real.diagnosis.schema import Cause, Equivalent, Finding

EFFECT_HINT = "record motions that part them: slow reversals, steps, chirps, holds in several poses, torque-off swings"  # noqa: E501


def cause_of(search: Search, weighed: Weighed, place: int) -> tuple[Cause, list[Contender]]:
    """Return a cause without its value, and those that other recordings may tell from it.

    Args:
        search: after its run.
        weighed: the causes.
        place: of the cause in their order.
    """
    found, member, rest = weighed.found, weighed.fit.members[place], weighed.rests()[place]
    share = float(weighed.shares[weighed.order[place]])
    rivals = found.rivals.get(member.label, [])
    seen = found.on(rest)
    crowd = equals(search, member, rivals, seen, found.on(found.error))
    named, crowd, same = _named(search, found, member, rivals, crowd)
    form = "contradicted" if fails(search, found, rest) else "holds"
    sure = confidence(search, member, [*crowd, *same], rivals, seen)
    extra = {**member.effect.extra, **member.effect.options()}
    if member.effect.place == "body":
        extra["body"] = member.effect.where
    cause = Cause(
        member.name,
        member.place,
        member.effect.side,
        0.0,
        (0.0, 0.0),
        member.effect.unit,
        extra,
        sure,
        share,
        form,
        named,
        member.shared,
    )
    return cause, crowd


def _named(
    search: Search,
    found: Found,
    member: Candidate,
    rivals: Sequence[Contender],
    crowd: Sequence[Contender],
) -> tuple[tuple[Equivalent, ...], list[Contender], list[Contender]]:
    """Return the equivalents that a report names, those that can be parted, and those that cannot.

    What no recording can part from the cause, or from an equivalent that is named, counts with it.
    """
    own = found.fit.values.mean(axis=0)[columns(found.fit.members)[found.fit.members.index(member)]]
    most = search.problem.data.settings.causes.equivalents_max
    known: list[tuple[Candidate, np.ndarray]] = [(member, own)]
    names: dict[tuple[str, str | None], Equivalent] = {}
    apart: list[Contender] = []
    alike: list[Contender] = []
    labels = [contender.candidate.label for contender in crowd]
    for contender in [*crowd, *(c for c in rivals if c.candidate.label not in labels)]:
        option = contender.candidate
        if option.label == member.label:
            continue
        one = option, value_of(contender).mean(axis=0)
        same = any(inseparable(search, other, one) for other in known)
        if not same and option.label not in labels:
            continue
        place = option.name, option.place
        (alike if same else apart).append(contender)
        full = 1 + sum(not one.inseparable for one in names.values()) >= most
        if place == (member.name, member.place) or place in names or (full and not same):
            continue
        known.append(one)
        names[place] = Equivalent(*place, inseparable=same)
    return tuple(names.values()), apart, alike


def unnamed(rivals: Sequence[Contender], cause: Cause, most: int) -> list[Contender]:
    """Return the nearest contenders for a cause's place that are no equivalent of it either."""
    named = {(cause.effect, cause.where), *((e.effect, e.where) for e in cause.equivalent)}
    free = [one for one in rivals if (one.candidate.name, one.candidate.place) not in named]
    return sorted(free, key=lambda one: float(np.square(one.error).sum()))[:most]


def fails(search: Search, found: Found, rest: np.ndarray) -> bool:
    """Return whether a cause's law fails somewhere; `rest`: errors without it, (W, T, M)."""
    if found.seen is not None:  # it was named although it fails elsewhere
        return True
    return contradicted(search.problem.data, search.blocks, rest, found.error)


def valued(cause: Cause, member: Candidate, values: np.ndarray, spans: np.ndarray) -> Cause:
    """Return the cause with its fitted values (P,) and their intervals (P, 2)."""
    free = {e.name for e in member.effect.extras if e.name in member.effect.free}
    own = [e.name for e in member.effect.extras if e.name in free]
    first = len(values) - len(own)
    extra = {**cause.extra, **dict(zip(own, map(float, values[first:]), strict=True))}
    if first > 1:
        extra["values"] = [float(v) for v in values[:first]]
    most = int(np.abs(values[:first]).argmax())  # of several values, such as a tilt's, the largest
    kept = {k: v for k, v in vars(cause).items() if k not in ("value", "value_ci", "extra")}
    ends = (float(spans[most, 0]), float(spans[most, 1]))
    return Cause(**kept, value=float(values[most]), value_ci=ends, extra=extra)


def crowded(cause: Cause, crowd: Sequence[Contender]) -> Finding:
    """Return a finding that names all that cannot be told from a cause."""
    names = ", ".join(c.candidate.label for c in crowd)
    return Finding(
        "excitation",
        cause.where,
        f"the log cannot tell {cause.effect} from {len(crowd)} other effects: {names}",
        EFFECT_HINT,
    )
