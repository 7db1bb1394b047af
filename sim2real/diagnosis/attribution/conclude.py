"""From what attribution found to a report: verdict, causes with intervals, evidence.

report = conclude(search, found, floors, rng)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim2real.diagnosis.attribution.alike import calibrated, confidence, equals
from sim2real.diagnosis.attribution.attribute import Contender, Found, Search
from sim2real.diagnosis.attribution.background import shifts
from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.doubts import doubts
from sim2real.diagnosis.attribution.equivalents import (
    explanations,
    inseparable,
    value_of,
    with_rivals,
)
from sim2real.diagnosis.attribution.fit import Fit, columns
from sim2real.diagnosis.attribution.judge import Judge
from sim2real.diagnosis.attribution.locate import bands, locate
from sim2real.diagnosis.attribution.parsimony import dropped, neutral
from sim2real.diagnosis.attribution.quantify import (
    Spread,
    as_gaps,
    coalitions,
    contradicted,
    intervals,
    one_less,
    shapley,
    without,
)
from sim2real.diagnosis.attribution.residual import describe
from sim2real.diagnosis.attribution.sharper import sharper, told
from sim2real.diagnosis.attribution.singles import singles
from sim2real.diagnosis.attribution.usual import Usual
from sim2real.diagnosis.attribution.verdict import verdict_of
from sim2real.diagnosis.evidence import Band, Rung, SingleFit
from sim2real.diagnosis.schema import (
    Cause,
    Equivalent,
    Finding,
    GapNumbers,
    Report,
    Unexplained,
    Verdict,
    Where,
)
from sim2real.diagnosis.settings import TINY_SQUARE

Set = frozenset[int]


@dataclass(frozen=True)
class Conclusion:
    """A report without its evidence's pictures, and the fit behind it, causes in their order."""

    report: Report
    fit: Fit
    ladder: tuple[Rung, ...]
    singles: tuple[SingleFit, ...]
    bands: tuple[Band, ...]
    intervals: np.ndarray  # (P, 2)
    errors: Mapping[Set, np.ndarray]  # held out, (W, T, M), with these causes, by their places
    correlations: np.ndarray  # (n, n) of the causes' first values
    alike: tuple[tuple[str, Fit], ...] = ()  # labels and fits that the data cannot tell apart


def nothing(search: Search, floors: np.ndarray, rng: np.random.Generator) -> Conclusion:
    """Return the conclusion where there is no gap; see `conclude`."""
    data, base = search.problem.data, search.base
    gap = GapNumbers(data.unit, search.before, None, search.floor, None, None, True)
    where, spectrum = _where(search, None, floors, rng)
    report = Report("no_gap", gap, where, (), Unexplained(0.0, "none"))
    rung = Rung("as given", search.before, search.blocks.interval(base))
    floor = Rung("noise floor", search.floor, (search.floor, search.floor))
    empty = np.zeros((0, 2))
    errors = {frozenset[int](): base}
    return Conclusion(
        report, search.none, (rung, floor), (), spectrum, empty, errors, np.zeros((0, 0))
    )


def unsearched(
    search: Search, floors: np.ndarray, rng: np.random.Generator, why: str
) -> Conclusion:
    """Return the conclusion of a log in which no cause can be looked for; see `conclude`.

    Args:
        search: before its run.
        floors: see `conclude`.
        rng: see `conclude`.
        why: what is wrong with the log.
    """
    made = nothing(search, floors, rng)
    gap = replace(made.report.gap, after=search.before, closed=0.0, closed_ci=(0.0, 0.0))
    left = Unexplained(1.0, why)
    report = replace(made.report, verdict="unexplained", gap=gap, unexplained=left)
    return replace(made, report=report)


def conclude(
    search: Search, found: Found, floors: np.ndarray, rng: np.random.Generator
) -> Conclusion:
    """Return what a search found, as a report, without causes whose intervals hold neutral.

    Args:
        search: after its run.
        found: what it returned.
        floors: noise floor of each joint [rad or m], (M,).
        rng: for the intervals.
    """
    data, blocks, floor = search.problem.data, search.blocks, search.floor
    limits = data.settings.causes
    subsets, shares = _weighed(search, found)
    order = [int(i) for i in np.argsort(-shares)]
    fit = without(found.fit, order)
    after = blocks.rms(found.error)
    closed, ci = blocks.closed(search.base, found.error, floor)
    every = frozenset(range(_count(found)))
    rests = np.array([blocks.rms(subsets[every - {number}]) for number in order])
    least = limits.left_min * after**2 + TINY_SQUARE
    left = after / np.sqrt(np.maximum(rests**2 - after**2, least))
    spread = Spread(np.zeros((0, 2)), np.zeros((0, 0)))
    if order:
        beside = shifts(search, fit)
        spread = intervals(search.problem, fit, left, rng, blocks.seconds, beside)
    if nil := neutral(fit, spread.ends):
        fewer = dropped(search, found, [order[number] for number in nil])
        return conclude(search, fewer, floors, rng)
    found = with_rivals(search, found)
    spans, starts = spread.ends, [place.start for place in columns(fit.members)]
    text = describe(data, found.error, floor)
    form = len(order) != 1 or not _wrong(search, found, subsets[frozenset()])
    judge = Judge(search, fit.members, floors, form)
    given = judge.rest(search.base, found.error)
    rested = [subsets[every - {number}] for number in order]
    plain = verdict_of(given, data)
    verdict, clear = _beside_usual(search, plain, rested, found.error)
    tried = plain == "partly_explained" and min(clear) >= 1  # of what usual errors make
    made = [
        _cause(search, found, member, rested[place], float(shares[number]), closed)
        for place, (number, member) in enumerate(zip(order, fit.members, strict=True))
    ]
    unnamed = [
        _unnamed(found.rivals.get(member.label, []), cause, data.settings.numerics.contenders)
        for member, (cause, _) in zip(fit.members, made, strict=True)
    ]
    others = [instead for _, instead in explanations(fit, unnamed)[1:]]
    sharp = sharper(judge, fit, given, others) if tried else None
    verdict = verdict if sharp is None else "explained"
    causes, findings, sets = [], doubts(fit.members, search.witnessed), []
    findings += [] if sharp is None else [told(sharp, after, data.unit)]
    sure = closed if sharp is None else max(sharp.rest.closed, closed)
    for place, (member, (cause, crowd)) in enumerate(zip(fit.members, made, strict=True)):
        doubt = limits.usual_doubt * (1 - clear[place])
        cause = replace(cause, confidence=cause.confidence * (1 - doubt))
        cause = replace(cause, confidence=calibrated(cause.confidence, sure, limits))
        own = columns(fit.members)[place]
        causes.append(_valued(cause, member, fit.mean[own], spans[own]))
        findings += [_crowded(cause, crowd)] if len(crowd) >= limits.equivalents_max else []
        sets.append(crowd[: limits.equivalents_max - 1])
    where, spectrum = _where(search, found.error, floors, rng)
    gap = GapNumbers(data.unit, search.before, after, floor, closed, ci, True)
    many = len(causes) > data.settings.verdict.causes_max
    report = Report(
        verdict,
        gap,
        where,
        () if many else tuple(causes),
        Unexplained(float(np.clip(1 - closed, 0.0, 1.0)), text),
        tuple(findings),
        fitted=tuple(causes) if many else (),
    )
    return Conclusion(
        report,
        fit,
        _ladder(search, found, subsets, order),
        singles(search, found, [found.fit.members[number] for number in order]),
        spectrum,
        spans,
        _by_place(subsets, order, search.base),
        spread.correlation[np.ix_(starts, starts)],
        explanations(fit, sets),
    )


def _beside_usual(
    search: Search, verdict: Verdict, rests: Sequence[np.ndarray], full: np.ndarray
) -> tuple[Verdict, list[float]]:
    """Return the verdict, and how clear of a model's usual errors each cause is, from 0 to 1.

    Several causes of which one closes no more than usual errors make explain a part at best:
    together they imitate a model that is a few per cent off everywhere. Of other explanations
    nothing is doubted.

    Args:
        search: after its run.
        verdict: what the gap alone says.
        rests: held-out errors without each cause, (W, T, M) each.
        full: with all of them.
    """
    many = len(rests) >= search.problem.data.settings.causes.usual_causes
    if not rests or (verdict == "explained" and not many):
        return verdict, [1.0] * len(rests)
    usual = Usual(search)
    clear = [usual.clear(rest, full) for rest in rests]
    if verdict != "explained":
        return verdict, clear
    return (verdict, [1.0] * len(rests)) if min(clear) > 0 else ("partly_explained", clear)


def _weighed(search: Search, found: Found) -> tuple[dict[Set, np.ndarray], np.ndarray]:
    """Return held-out errors without some causes, and each cause's share of the closable gap, (n,).

    Of few causes every subset is fitted anew, and the shares are Shapley's. Of many only the others
    are looked at without each, and the shares are as large as these falls, in proportion.
    """
    blocks, room = search.blocks, max(search.before - search.floor, TINY_SQUARE)
    if _count(found) <= search.problem.data.settings.causes.subsets_max:
        subsets = coalitions(search.problem, search.racing, found.fit, found.error)
        gaps = {subset: blocks.rms(error) for subset, error in subsets.items()}
        worth = {s: min((search.before - gap) / room, 1.0) for s, gap in gaps.items()}
        return subsets, np.minimum(shapley(worth, _count(found)), 1.0)
    subsets, every = one_less(search.problem, found.fit, found.error), range(_count(found))
    after = blocks.rms(found.error)
    falls = np.array([blocks.rms(subsets[frozenset(every) - {i}]) - after for i in every])
    falls = np.maximum(falls, 0.0)
    closed = min((search.before - after) / room, 1.0)
    return subsets, closed * falls / max(falls.sum(), TINY_SQUARE)


def _by_place(
    subsets: Mapping[Set, np.ndarray], order: Sequence[int], base: np.ndarray
) -> dict[Set, np.ndarray]:
    """Return errors by the causes' places in the report; those without any are the base."""
    place = {number: at for at, number in enumerate(order)}
    return {
        frozenset(): base,
        **{frozenset(place[n] for n in some): error for some, error in subsets.items() if some},
    }


def _count(found: Found) -> int:
    return len(found.fit.members)


def _cause(
    search: Search, found: Found, member: Candidate, rest: np.ndarray, share: float, closed: float
) -> tuple[Cause, list[Contender]]:
    """Return a cause without its value, and those that other recordings may tell from it."""
    rivals = found.rivals.get(member.label, [])
    seen = found.on(rest)
    crowd = equals(search, member, rivals, seen, found.on(found.error))
    named, crowd, same = _named(search, found, member, rivals, crowd)
    form = "contradicted" if _wrong(search, found, rest) else "holds"
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


def _unnamed(rivals: Sequence[Contender], cause: Cause, most: int) -> list[Contender]:
    """Return the nearest contenders for a cause's place that are no equivalent of it either."""
    named = {(cause.effect, cause.where), *((e.effect, e.where) for e in cause.equivalent)}
    free = [one for one in rivals if (one.candidate.name, one.candidate.place) not in named]
    return sorted(free, key=lambda one: float(np.square(one.error).sum()))[:most]


def _wrong(search: Search, found: Found, rest: np.ndarray) -> bool:
    """Return whether a cause's law fails somewhere; `rest`: errors without it, (W, T, M)."""
    if found.seen is not None:  # it was named although it fails elsewhere
        return True
    return contradicted(search.problem.data, search.blocks, rest, found.error)


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
        if place == (member.name, member.place) or place in names or len(apart) > most - 1:
            continue
        known.append(one)
        names[place] = Equivalent(*place, inseparable=same)
    return tuple(names.values()), apart, alike


def _valued(cause: Cause, member: Candidate, values: np.ndarray, spans: np.ndarray) -> Cause:
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


def _crowded(cause: Cause, crowd: list[Contender]) -> Finding:
    names = ", ".join(c.candidate.label for c in crowd)
    return Finding(
        "excitation",
        cause.where,
        f"the log cannot tell {cause.effect} from {len(crowd)} other effects: {names}",
        EFFECT_HINT,
    )


EFFECT_HINT = "record motions that part them: slow reversals, steps, chirps, holds in several poses, torque-off swings"  # noqa: E501


def _where(
    search: Search, after: np.ndarray | None, floors: np.ndarray, rng: np.random.Generator
) -> tuple[tuple[Where, ...], tuple[Band, ...]]:
    """Return where the gap lies, by joint and kind of moment, and by frequency."""
    data = search.problem.data
    floor = {joint.name: float(f) for joint, f in zip(data.joints, floors, strict=True)}
    scale = {joint.name: joint.scale for joint in data.joints}
    gaps = as_gaps(data, search.base)
    later = [] if after is None else as_gaps(data, after)
    which = [next(w.model for w in data.windows if w.log == n) for n in range(len(data.logs))]
    models = [data.models[index] for index in which]
    settings = data.settings
    table = locate(gaps, floor, models, later, rng=rng, scale=scale, settings=settings)
    return table.where, bands(gaps, floor, later, settings.locating)


def _ladder(
    search: Search, found: Found, subsets: dict[Set, np.ndarray], order: list[int]
) -> tuple[Rung, ...]:
    """Return the gap as given, after each cause in their order, and the floor."""
    rungs = [Rung("as given", search.before, search.blocks.interval(search.base))]
    steps = [
        (found.fit.members[order[size - 1]].label, subsets[frozenset(order[:size])])
        for size in range(1, len(order) + 1)
        if len(order) <= search.problem.data.settings.causes.subsets_max
    ]
    for label, error in steps or found.steps:
        rungs.append(Rung(f"+ {label}", search.blocks.rms(error), search.blocks.interval(error)))
    return (*rungs, Rung("noise floor", search.floor, (search.floor, search.floor)))
