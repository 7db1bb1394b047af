"""From what attribution found to a report: verdict, causes with intervals, evidence.

    report = conclude(search, found, floors, rng)

Verdicts, with the limits of `settings.Verdict`: `no_gap` if the gap is within twice the noise floor
or two encoder counts; `explained` if what is left is within twice the floor, or nine tenths are
closed; `partly_explained` from three tenths with a lower bound above zero; else `unexplained`.
`explained` is said of the gap, not of the rest: where more than twice the floor is left, the report
and the terminal say how many floors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sim2real.diagnosis.attribution.attribute import Contender, Found, Search
from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.fit import Fit, columns
from sim2real.diagnosis.attribution.locate import bands, locate
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
from sim2real.diagnosis.attribution.singles import singles
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.schema import (
    Band,
    Cause,
    Equivalent,
    Finding,
    GapNumbers,
    Report,
    Rung,
    SingleFit,
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


def resolution(data: Data) -> float:
    """Return what encoder counts hide of a gap, in the units of errors."""
    counts = np.array([joint.count / joint.scale for joint in data.joints])
    return float(data.settings.verdict.no_gap_counts * np.sqrt(np.mean(counts**2)))


def stands_out(error: np.ndarray, data: Data, floors: np.ndarray) -> bool:
    """Return whether one joint is further off than noise and rounding make, whatever the others do.

    Args:
        error: in the units of `data`, (W, T, M).
        data: the windows.
        floors: noise floor of each joint [rad or m], (M,).
    """
    counts, limits = np.array([joint.count for joint in data.joints]), data.settings.verdict
    least = np.maximum(limits.joint_floors * floors, limits.joint_counts * counts)
    return bool((np.sqrt(data.mean_squares(error)) * data.scale > least).any())


def is_no_gap(before: float, floor: float, data: Data, alone: bool) -> bool:
    """Return whether a gap is within what noise and rounding make; `alone`: see `stands_out`."""
    return not alone and before <= max(
        data.settings.verdict.no_gap_floors * floor, resolution(data)
    )


def verdict_of(
    before: float,
    after: float,
    floor: float,
    closed: float,
    low: float,
    data: Data,
    alone: tuple[bool, bool],
) -> Verdict:
    """Return the verdict on a gap.

    Args:
        before: the gap as given.
        after: what is left of it.
        floor: the noise floor.
        closed: the share that is closed.
        low: its lower bound.
        data: the windows.
        alone: whether one joint stands out, before and after.
    """
    if is_no_gap(before, floor, data, alone[0]):
        return "no_gap"
    limits = data.settings.verdict
    if (after <= limits.no_gap_floors * floor and not alone[1]) or closed >= limits.explained:
        return "explained"
    return "partly_explained" if closed >= limits.partly and low > 0 else "unexplained"


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


def conclude(
    search: Search, found: Found, floors: np.ndarray, rng: np.random.Generator
) -> Conclusion:
    """Return what a search found, as a report.

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
    nothing_found = Spread(np.zeros((0, 2)), np.zeros((0, 0)))
    spread = intervals(search.problem, fit, left, rng) if order else nothing_found
    spans, starts = spread.ends, [place.start for place in columns(fit.members)]
    causes, findings, alike = [], [], ()
    for place, number in enumerate(order):
        member = found.fit.members[number]
        rest = subsets[every - {number}]
        cause, crowd = _cause(search, found, member, rest, float(shares[number]), closed)
        own = columns(fit.members)[place]
        causes.append(_valued(cause, member, fit.mean[own], spans[own]))
        findings += [_crowded(cause, crowd)] if len(crowd) >= limits.equivalents_max else []
        if cause.equivalent and not alike:
            others = [(c.candidate.label, c.fit) for c in crowd[: limits.equivalents_max - 1]]
            alike = ((member.label, found.fit), *others)
    text = describe(data, found.error, floor)
    alone = stands_out(search.base, data, floors), stands_out(found.error, data, floors)
    where, spectrum = _where(search, found.error, floors, rng)
    gap = GapNumbers(data.unit, search.before, after, floor, closed, ci, True)
    report = Report(
        verdict_of(search.before, after, floor, closed, ci[0], data, alone),
        gap,
        where,
        tuple(causes),
        Unexplained(float(np.clip(1 - closed, 0.0, 1.0)), text),
        tuple(findings),
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
        alike,
    )


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
    """Return a cause without its value, and those that the data cannot tell from it."""
    rivals = found.rivals.get(member.label, [])
    seen = found.on(rest)
    crowd = _equals(search, member, rivals, seen, found.on(found.error))
    names: dict[tuple[str, str | None], None] = {}
    for contender in crowd:
        place = (contender.candidate.name, contender.candidate.place)
        if place != (member.name, member.place):
            names[place] = None
    most = search.problem.data.settings.causes.equivalents_max
    alike = tuple(Equivalent(*name) for name in list(names)[: most - 1])
    wrong = found.seen is not None  # it was named although it fails elsewhere
    wrong = wrong or contradicted(search.problem.data, search.blocks, rest, found.error)
    form = "contradicted" if wrong else "holds"
    sure = _confidence(search, member, crowd, rivals, seen, closed)
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
        alike,
    )
    return cause, crowd


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


def _equals(
    search: Search, member: Candidate, rivals: list[Contender], rest: np.ndarray, full: np.ndarray
) -> list[Contender]:
    """Return the rivals that do as well as a member on held-out windows, the best first."""
    blocks, limits = search.blocks, search.problem.data.settings.causes
    own = next((c.error for c in rivals if c.candidate.label == member.label), full)
    best, worth = blocks.rms(own), max(blocks.rms(rest) - blocks.rms(own), 0.0)
    floors = search.settings.worth_floors * search.floor
    near = max(limits.equal_share * worth, min(floors, limits.equal_worth * worth))
    found = []
    for contender in rivals:
        if contender.candidate.label == member.label:
            continue
        low, _ = blocks.gain(contender.error, own)
        behind = blocks.rms(contender.error) - best
        if behind < near or (low <= 0 and behind < limits.equal_unsure * worth):
            found.append(contender)
    return found


def _confidence(
    search: Search,
    member: Candidate,
    crowd: list[Contender],
    rivals: list[Contender],
    rest: np.ndarray,
    closed: float,
) -> float:
    """Return the probability that a cause, or an equal of it, is really there.

    How often it wins when blocks are drawn again, less where the next rival is close behind or
    much of the gap stays. Where it never raced against others, nothing is known of that.
    """
    blocks, limits = search.blocks, search.problem.data.settings.causes
    good = {member.label, *(c.candidate.label for c in crowd)}
    others = [c for c in rivals if c.candidate.label not in good]
    own = [c for c in rivals if c.candidate.label in good]
    if not own:
        wins, margin = limits.unrivalled, 1.0
    elif not others:  # the screening has ruled all of them out
        wins, margin = 1.0, 1.0
    else:
        best = np.min([blocks.drawn(c.error) for c in own], axis=0)
        next_best = np.min([blocks.drawn(c.error) for c in others], axis=0)
        wins = float(np.mean(best < next_best))
        worth = blocks.rms(rest) - min(blocks.rms(c.error) for c in own)
        gap = min(blocks.rms(c.error) for c in others) - min(blocks.rms(c.error) for c in own)
        margin = gap / max(worth, TINY_SQUARE)
    near = np.exp(-max(margin, 0.0) / limits.rival_margin)
    sure = limits.sure_max * wins * (1 - limits.rival_doubt * near)
    doubt = limits.open_doubt
    sure *= (1 - doubt) + doubt * np.clip(closed, 0, 1)
    return float(np.clip(sure, limits.confidence_min, limits.confidence_max))


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
