"""From a judgement to a report: verdict, causes with intervals and equivalents, what is left.

made = make_conclusion(judgement, baseline, rng)
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from envs.effects import Effect
from envs.plant import Fixed
from sim2real.diagnosis.evidence import Band, Pair, Rung, SingleFit
from sim2real.diagnosis.inference.baseline import Baseline
from sim2real.diagnosis.inference.candidates import Candidate
from sim2real.diagnosis.inference.deviations import find_deviations
from sim2real.diagnosis.inference.distance import compute_separation
from sim2real.diagnosis.inference.events import EVENTS, GLITCH, PART, Event
from sim2real.diagnosis.inference.fit import Fit
from sim2real.diagnosis.inference.hypotheses import Member, get_effect, get_kind
from sim2real.diagnosis.inference.intervals import compute_intervals
from sim2real.diagnosis.inference.judge import Judgement
from sim2real.diagnosis.inference.log_change import LogChange
from sim2real.diagnosis.inference.moves import is_part
from sim2real.diagnosis.inference.remainder import describe_remainder
from sim2real.diagnosis.schema import Cause, Equivalent, GapMetrics, JointGap, Report, Unexplained
from sim2real.diagnosis.settings import TINY

SAME = 1e-4  # of what an explanation gains: predictions that differ by 1 % of its change are equal


@dataclass(frozen=True)
class Conclusion:
    """A report without its evidence's pictures, and the fit behind it, causes in their order."""

    report: Report
    found: tuple[Fixed, ...]  # the effects on the robot and its world, with their values
    intervals: tuple[Pair, ...]  # of each one's first value
    ladder: tuple[Rung, ...]  # the gap as given, with the causes, and the floor
    singles: tuple[SingleFit, ...]  # explanations of one change
    bands: tuple[Band, ...]  # the gap by frequency
    # held out, (W, T, M), as given and with the causes, by their places
    errors: Mapping[frozenset[int], np.ndarray]
    correlations: np.ndarray  # (n, n) of the causes' first values
    # labels and effects of explanations that the logs cannot tell apart
    alike: tuple[tuple[str, tuple[Fixed, ...]], ...] = ()


class _Part(NamedTuple):
    """One change of the answer; a member that each joint has a value of its own for has several."""

    member: Member
    column: slice  # of the fit's values
    place: int  # of the member, among the hypothesis's
    lost: float  # nats, without it


def make_conclusion(
    judgement: Judgement, baseline: Baseline, rng: np.random.Generator
) -> Conclusion:
    """Return a judgement on a gap as a report, and the fit behind it; `rng` draws intervals."""
    best = judgement.best
    error = judgement.judge.replay_errors(best)
    parts = _parts(judgement)
    by_place = [find_equivalents(judgement, n) for n in range(len(best.hypothesis.members))]
    others = [member for own in by_place for member, _ in own]
    alike = [by_place[part.place] for part in parts]
    ends, correlation = compute_intervals(judgement.judge.fitter, best, others)
    closed, ci = baseline.closed(error)
    lost = np.array([max(part.lost, 0.0) for part in parts])
    shares = closed * lost / max(float(lost.sum()), TINY)
    causes = [
        _cause(judgement, part, ends, own, float(share))
        for part, own, share in zip(parts, alike, shares, strict=True)
    ]
    if judgement.verdict not in ("explained", "partly_explained"):
        causes, parts = [], []
    effects = [(get_effect(part.member), part.column) for part in parts]
    firsts = [column.start for effect, column in effects if effect is not None]
    named = frozenset(range(len(causes)))
    after = error if named else baseline.errors
    where, spectrum = baseline.locate(after if named else None, rng)
    found = _known(best, effects)
    return Conclusion(
        _report(judgement, baseline, causes, after, (closed, ci), where),
        found,
        tuple((float(ends[first, 0]), float(ends[first, 1])) for first in firsts),
        _ladder(baseline, best, after if named else None),
        _singles(judgement, baseline),
        spectrum,
        {frozenset(): baseline.errors, named: after},
        correlation[np.ix_(firsts, firsts)],
        _explanations(found, best, alike) if len(found) == len(causes) else (),
    )


def effects_of(fit: Fit) -> tuple[Fixed, ...]:
    """Return the effects of a fit with their values."""
    return _known(fit, [(get_effect(member), column) for member, column, _ in fit.hypothesis.parts])


def _known(fit: Fit, effects: Sequence[tuple[Effect | None, slice]]) -> tuple[Fixed, ...]:
    """Return the effects that there are, with their values of a fit."""
    own = [(effect, fit.mean[column]) for effect, column in effects if effect is not None]
    return tuple((effect, tuple(map(float, values))) for effect, values in own)


def _report(
    judgement: Judgement,
    baseline: Baseline,
    causes: Sequence[Cause],
    after: np.ndarray,
    closed: tuple[float, Pair],
    where: tuple[JointGap, ...],
) -> Report:
    """Return the report; `after` are errors (W, T, M) with the causes, `closed` what they do."""
    verdict, (share, ci) = judgement.verdict, closed
    if not causes:
        share, ci = 0.0, (0.0, 0.0)
    none, left = verdict == "no_gap", verdict not in ("no_gap", "explained")
    size = None if none else baseline.blocks.rms(after)
    numbers = (None, None) if none else (share, ci)
    events = [_event(judgement, event) for event in judgement.events]
    return Report(
        verdict,
        GapMetrics(baseline.data.unit, baseline.before, size, baseline.floor, *numbers, True),
        where,
        (*causes, *events),
        Unexplained(
            0.0 if none else float(np.clip(1 - share, 0.0, 1.0)),
            describe_remainder(judgement) if left else "none",
        ),
        deviations=find_deviations(judgement),
    )


def _ladder(baseline: Baseline, best: Fit, after: np.ndarray | None) -> tuple[Rung, ...]:
    """Return the gap as given, with the causes and the floor."""
    blocks, floor = baseline.blocks, baseline.floor
    steps = [("as given", baseline.errors)]
    steps += [] if after is None else [(f"+ {best.label}", after)]
    rungs = [Rung(label, blocks.rms(error), blocks.interval(error)) for label, error in steps]
    return (*rungs, Rung("noise floor", floor, (floor, floor)))


def _event(judgement: Judgement, event: Event) -> Cause:
    """Return an event as a cause: not what it closes is known, but that most of the rest is its."""
    data, settings = judgement.judge.data, judgement.judge.settings
    joint = next(joint for joint in data.joints if joint.name == event.joint)
    glitch, (start, end) = event.effect == GLITCH, event.seconds
    force = "N·m" if joint.unit == "rad" else "N"
    instead = dict.fromkeys(_list_instead(judgement, event))
    rows = f"qpos.{joint.name}: leave out {start:.2f} to {end:.2f} s of episode {event.episode}"
    return Cause(
        event.effect,
        event.joint,
        None,
        event.size,
        (min(event.size, 0.0), max(event.size, 0.0)),
        joint.unit if glitch else force,
        {"episode": event.episode},
        1 - settings.level,
        0.0,
        equivalent=tuple(instead)[: settings.equivalents_max - 1],
        kind=EVENTS[event.effect],
        seconds=event.seconds,
        remedy=rows if glitch else None,
    )


def _list_instead(judgement: Judgement, event: Event) -> Iterator[Equivalent]:
    """Yield what else an event may be: one of the other kind, or what leaves as little of it.

    What acts at one moment only, as a torque beyond a speed that is reached once, predicts no other
    stretch: whether it was that or a push, these recordings do not tell once it is fitted to it.
    """
    if event.rival is not None:
        yield Equivalent(event.rival, event.joint, kind=EVENTS[event.rival])
    judge, best = judgement.judge, judgement.best
    most = (1 - PART) * judge.excess(best.held)[event.window].sum()
    kept = {member.label for member in best.hypothesis.members}
    for rival in judgement.rivals:
        added = [member for member in rival.hypothesis.members if member.label not in kept]
        one_more = is_part(best.hypothesis, rival.hypothesis) and len(added) == 1
        if one_more and judge.excess(rival.own)[event.window].sum() <= most:
            yield Equivalent(added[0].name, added[0].place, kind=get_kind(added[0]))


def _parts(judgement: Judgement) -> list[_Part]:
    """Return the changes of the answer, those of the member that is missed most first."""
    best, given = judgement.best, judgement.given
    known = {fit.label: fit for fit in [given, *judgement.rivals]}
    lost = [
        best.total - known.get(best.hypothesis.without(place).label, given).total
        for place in range(len(best.hypothesis.members))
    ]
    parts = best.hypothesis.parts
    count = Counter(place for _, _, place in parts)
    found = [_Part(*part, lost[part[2]] / count[part[2]]) for part in parts]
    return sorted(found, key=lambda part: -lost[part.place])


def find_equivalents(judgement: Judgement, place: int) -> list[tuple[Member, Fit]]:
    """Return what is equivalent to a member: others in its place, fitted to the end as well."""
    best, found = judgement.best, []
    rest = {m.label for n, m in enumerate(best.hypothesis.members) if n != place}
    for rival in judgement.rivals:
        others = [m for m in rival.hypothesis.members if m.label not in rest]
        same = len(rival.hypothesis.members) == len(best.hypothesis.members)
        if same and len(others) == 1 and not judgement.judge.distance.distinguishes(best, rival):
            found.append((others[0], rival))
    return found


def _equivalent(judgement: Judgement, member: Member, fit: Fit) -> Equivalent:
    """Return what is equivalent to a member; inseparable where all predictions are the same."""
    best, gained = judgement.best, judgement.best.total - judgement.given.total
    same = compute_separation(judgement.judge.fitter, best, fit) < SAME * gained
    return Equivalent(member.name, member.place, same, kind=get_kind(member))


def _cause(
    judgement: Judgement,
    part: _Part,
    ends: np.ndarray,
    alike: Sequence[tuple[Member, Fit]],
    closed: float,
) -> Cause:
    """Return a change of the answer as a cause."""
    best, member, column = judgement.best, part.member, part.column
    own = best.hypothesis.members[part.place].label
    names = {own, *(other.label for other, _ in alike)}
    sure = sum(
        float(chance)
        for fit, chance in zip([best, *judgement.rivals], judgement.probability, strict=True)
        if any(m.label in names for m in fit.hypothesis.members)
    )
    values, spans = best.mean[column], ends[column]
    equal = tuple(dict.fromkeys(_equivalent(judgement, other, fit) for other, fit in alike))
    equal = tuple(e for e in equal if (e.effect, e.where) != (member.name, member.place))
    extra = _extra(member, values)
    most = _largest(member, values)
    change = isinstance(member, LogChange)
    value = member.first(values) if change else float(values[most])
    return Cause(
        member.name,
        member.place,
        member.effect.side if isinstance(member, Candidate) else None,
        value,
        (float(spans[most, 0]), float(spans[most, 1])) if len(values) else (value, value),
        member.unit,
        extra,
        min(sure, 1.0),
        closed,
        equivalent=equal[: judgement.judge.settings.equivalents_max - 1],
        shared=isinstance(member, Candidate) and member.shared,
        kind=get_kind(member),
        seconds=member.seconds if change else None,
        remedy=member.mending(values) if change and member.effect is None else None,
    )


def _largest(member: Member, values: np.ndarray) -> int:
    """Return which value stands for all: of several, such as a tilt's, the largest."""
    if not isinstance(member, Candidate):
        return 0
    first = max(len(values) - len(member.effect.free), 1)
    return int(np.abs(values[:first]).argmax())


def _extra(member: Member, values: np.ndarray) -> dict[str, object]:
    """Return the further scalars and options of a member."""
    if not isinstance(member, Candidate):
        found: dict[str, object] = {"columns": list(member.columns)}
        found |= {"other": member.other} if member.other else {}
        return found | ({"values": [float(v) for v in values]} if len(values) > 1 else {})
    effect = member.effect
    found: dict[str, object] = {**effect.extra, **effect.options()}
    if effect.place == "body":
        found["body"] = effect.where
    own = [e.name for e in effect.extras if e.name in effect.free]
    first = len(values) - len(own)
    found |= dict(zip(own, map(float, values[first:]), strict=True))
    if first > 1:
        found["values"] = [float(v) for v in values[:first]]
    return found


def _explanations(
    own: tuple[Fixed, ...], best: Fit, alike: Sequence[Sequence[tuple[Member, Fit]]]
) -> tuple[tuple[str, tuple[Fixed, ...]], ...]:
    """Return the explanations that these logs cannot tell apart; none where there is one alone.

    The same laws with further values, such as friction's bristles, are no other explanation.
    """
    laws, others = {member.law for member in best.hypothesis.members}, {}
    for fit in (fit for crowd in alike for _, fit in crowd):
        members = fit.hypothesis.members
        if {m.law for m in members} != laws and None not in map(get_effect, members):
            others[fit.label] = effects_of(fit)
    return ((best.label, own), *others.items()) if others else ()


def _singles(judgement: Judgement, baseline: Baseline) -> tuple[SingleFit, ...]:
    """Return the hypotheses of one member that were fitted to the end, the best first."""
    rows = []
    for fit in sorted([judgement.best, *judgement.rivals], key=lambda fit: -fit.total):
        if len(fit.hypothesis.members) == 1:
            (member,) = fit.hypothesis.members
            closed, ci = baseline.closed(judgement.judge.replay_errors(fit))
            change = isinstance(member, LogChange)
            value = member.first(fit.mean) if change else float(fit.mean[0])
            side = member.effect.side if isinstance(member, Candidate) else None
            about = (member.name, member.place, side, value, member.unit)
            rows.append(SingleFit(*about, min(closed, 1.0), ci))
    return tuple(rows)
