"""From what attribution found to a report: verdict, causes with intervals, evidence.

report = conclude(search, found, floors, rng)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.attribution.alike import calibrated
from sim2real.diagnosis.attribution.attribute import Found, Search
from sim2real.diagnosis.attribution.causes import cause_of, crowded, fails, unnamed, valued
from sim2real.diagnosis.attribution.doubts import doubts
from sim2real.diagnosis.attribution.equivalents import explanations
from sim2real.diagnosis.attribution.fit import Fit, columns
from sim2real.diagnosis.attribution.judge import Judge
from sim2real.diagnosis.attribution.locate import bands, locate
from sim2real.diagnosis.attribution.quantify import as_gaps
from sim2real.diagnosis.attribution.residual import describe
from sim2real.diagnosis.attribution.sharper import Sharp, sharper, told
from sim2real.diagnosis.attribution.singles import singles
from sim2real.diagnosis.attribution.usual import Usual
from sim2real.diagnosis.attribution.verdict import verdict_of
from sim2real.diagnosis.attribution.weigh import Set, Weighed, weigh
from sim2real.diagnosis.evidence import Band, Rung, SingleFit
from sim2real.diagnosis.schema import Cause, GapMetrics, JointGap, Report, Unexplained, Verdict


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


class _Judged(NamedTuple):
    """The verdict on causes, how clear each is of a model's usual errors, and what shows it."""

    verdict: Verdict
    clear: list[float]  # of each cause, 0 to 1
    sharp: Sharp | None


def nothing(search: Search, floors: np.ndarray, rng: np.random.Generator) -> Conclusion:
    """Return the conclusion where there is no gap; see `conclude`."""
    data, base = search.problem.data, search.base
    gap = GapMetrics(data.unit, search.before, None, search.floor, None, None, True)
    where, spectrum = where_of(search, None, floors, rng)
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
    weighed = weigh(search, found, rng)
    found, fit, order = weighed.found, weighed.fit, weighed.order
    text = describe(data, found.error, floor)
    closed, ci = blocks.closed(search.base, found.error, floor)
    after, most = blocks.rms(found.error), data.settings.causes.equivalents_max
    made = [cause_of(search, weighed, place) for place in range(len(order))]
    judged = _judged(search, weighed, [cause for cause, _ in made], floors)
    causes = _valued(search, weighed, [cause for cause, _ in made], judged, closed)
    findings = doubts(fit.members, search.witnessed)
    findings += [] if judged.sharp is None else [told(judged.sharp, after, data.unit)]
    findings += [crowded(cause, crowd) for cause, crowd in made if len(crowd) >= most]
    where, spectrum = where_of(search, found.error, floors, rng)
    many = len(causes) > data.settings.verdict.causes_max
    report = Report(
        judged.verdict,
        GapMetrics(data.unit, search.before, after, floor, closed, ci, True),
        where,
        () if many else causes,
        Unexplained(float(np.clip(1 - closed, 0.0, 1.0)), text),
        tuple(findings),
        fitted=causes if many else (),
    )
    starts = [place.start for place in columns(fit.members)]
    return Conclusion(
        report,
        fit,
        _ladder(search, found, weighed.subsets, order),
        singles(search, found, [found.fit.members[number] for number in order]),
        spectrum,
        weighed.spread.ends,
        _by_place(weighed.subsets, order, search.base),
        weighed.spread.correlation[np.ix_(starts, starts)],
        explanations(fit, [crowd[: most - 1] for _, crowd in made]),
    )


def _judged(
    search: Search, weighed: Weighed, causes: Sequence[Cause], floors: np.ndarray
) -> _Judged:
    """Return the verdict; what explains a part is looked at in a sharper simulation, too."""
    data, found, fit = search.problem.data, weighed.found, weighed.fit
    form = len(causes) != 1 or not fails(search, found, weighed.subsets[frozenset()])
    judge = Judge(search, fit.members, floors, form)
    given = judge.rest(search.base, found.error)
    plain = verdict_of(given, data)
    verdict, clear = _beside_usual(search, plain, weighed.rests(), found.error)
    if plain != "partly_explained" or min(clear) < 1:  # of what usual errors make
        return _Judged(verdict, clear, None)
    most = data.settings.numerics.contenders
    near = [
        unnamed(found.rivals.get(member.label, []), cause, most)
        for member, cause in zip(fit.members, causes, strict=True)
    ]
    sharp = sharper(judge, fit, given, [instead for _, instead in explanations(fit, near)[1:]])
    return _Judged(verdict if sharp is None else "explained", clear, sharp)


def _valued(
    search: Search, weighed: Weighed, causes: Sequence[Cause], judged: _Judged, closed: float
) -> tuple[Cause, ...]:
    """Return causes with their values and intervals, and with the confidence that is left."""
    fit, limits, made = weighed.fit, search.problem.data.settings.causes, []
    sure = closed if judged.sharp is None else max(judged.sharp.rest.closed, closed)
    places = columns(fit.members)
    for cause, member, own, clear in zip(causes, fit.members, places, judged.clear, strict=True):
        doubt = limits.usual_doubt * (1 - clear)
        trust = calibrated(cause.confidence * (1 - doubt), sure, limits)
        cause = replace(cause, confidence=trust)
        made.append(valued(cause, member, fit.mean[own], weighed.spread.ends[own]))
    return tuple(made)


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


def _by_place(
    subsets: Mapping[Set, np.ndarray], order: Sequence[int], base: np.ndarray
) -> dict[Set, np.ndarray]:
    """Return errors by the causes' places in the report; those without any are the base."""
    place = {number: at for at, number in enumerate(order)}
    return {
        frozenset(): base,
        **{frozenset(place[n] for n in some): error for some, error in subsets.items() if some},
    }


def where_of(
    search: Search, after: np.ndarray | None, floors: np.ndarray, rng: np.random.Generator
) -> tuple[tuple[JointGap, ...], tuple[Band, ...]]:
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
