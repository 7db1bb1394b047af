"""Scoring an exam: each answer against its key, and all of them with intervals.

    marks = [mark(key, report, closed) for ...]
    table = summary(marks)

Rules:

* The first cause is right if it, or a member of its equivalence set, is a hidden effect at its
  place. A set counts only if it has at most three members, the cause included; what no recording
  can part counts as one.
* Rank 3: every hidden effect is among the first three causes or their sets.
* The place of a body effect is the joint that moves the body. A robot of one joint has one place.
* An answer is a set if another recording could part a cause from an equivalent. The truth is inside
  if every hidden effect is a cause or an equivalent of one. An answer that is not a set is exact
  if, besides, nothing else is named.
* A verdict of `fitted` names no cause, so that nothing of it is right or superfluous.
* Nothing hidden: `no_gap` is right, everything else a false alarm.
* Effect removed from the candidates: anything but `explained` is right, if the joint with the
  largest share of the gap is the right one.
* `closed` is measured on a sealed log that the diagnosis never saw, by the exam's own replay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import stats

from envs.effects import EFFECTS
from sim2real.exam.hiding import EFFECTS as HIDDEN
from sim2real.runs import statistics
from sim2real.runs.statistics import Interval, bootstrap
from sim2real.runs.tables import Table

LARGEST_SET = 3
LEVEL = 0.95
DRAWS = 4000
EDGES = (0.0, 0.5, 0.8, 0.9, 0.95, 1.001)  # of the confidences in the table of calibration
# Effects whose value means the same in the emulator's laws and in the vocabulary's.
COMPARABLE = tuple(name for name in HIDDEN if EFFECTS[name].comparable)
Named = tuple[str, str | None]  # effect and place


@dataclass(frozen=True, kw_only=True)
class CaseMark:
    """The result of one case of any exam; None where a question does not apply."""

    case: str  # its name
    kind: str  # what was withheld
    robot: str  # its name
    hidden: str  # the hidden effects in words
    answer: str  # the verdict and the causes in words
    rank1: bool | None = None  # whether the first cause is right
    rank3: bool | None = None  # whether all hidden effects are among the first three
    place: bool | None = None  # whether the first place is right
    # relative error of the value of the first cause, where it can be compared
    error: float | None = None
    covered: bool | None = None  # whether its interval holds the truth
    confidence: float | None = None  # of the first cause
    # whether the first cause is right, for the calibration; None without a cause
    right: bool | None = None
    superfluous: int | None = None  # causes that nothing hidden stands behind
    # share of the closable gap that is closed on a log that the diagnosis never saw
    closed: float | None = None
    seconds: float | None = None  # the duration of the diagnosis
    reason: str = ""  # why it is wrong, for people; "" if it is right


@dataclass(frozen=True, kw_only=True)
class Mark(CaseMark):
    """What became of one case: of the kind one, two, none or excluded."""

    truths: tuple[str, ...]  # the hidden effects' names
    first: str  # the name that the answer gives at rank 1: the truth's if its set holds it
    recognized: bool | None = None  # whether a removed effect was not called explained
    alarm: bool | None = None  # with nothing hidden, whether the verdict was anything but no_gap
    claimed: float | None = None  # share of the closable gap that is closed, as the report says
    is_set: bool | None = None  # whether another recording could part a cause from an equivalent
    inside: bool | None = None  # of a set, whether all hidden effects are in it
    # of an answer that is none, whether it names the hidden effects and nothing else
    exact: bool | None = None


def mark(key: Mapping[str, Any], report: Mapping[str, Any] | None, closed: float | None) -> Mark:
    """Compare an answer with its key.

    Args:
        key: {name, kind, robot, truths, joints, bodies}; `joints` are the robot's, `bodies` says
            which joint moves which body.
        report: report.json; None if the diagnosis failed.
        closed: what the found effects close of the sealed log's gap; None if that was not measured.
    """
    places = Places(key["joints"], key["bodies"])
    truths = [(t["effect"], places.of(t["joint"])) for t in key["truths"]]
    hidden = ", ".join(describe(t) for t in key["truths"]) or "nothing"
    common = {
        "case": key["name"],
        "kind": key["kind"],
        "robot": key["robot"],
        "hidden": hidden,
        "truths": tuple(effect for effect, _ in truths),
    }
    if report is None:
        return _failed(common)
    causes = [members_of(cause, places) for cause in report["causes"]]
    common |= {
        "answer": words(report),
        "claimed": report["gap"]["closed"],
        "seconds": report["seconds"],
        "superfluous": sum(not set(members) & set(truths) for members in causes),
        "first": _first(report, causes, truths),
    }
    match key["kind"]:
        case "none":
            alarm = report["verdict"] != "no_gap"
            return Mark(**common, alarm=alarm, reason="a false alarm" if alarm else "")
        case "excluded":
            return _excluded(common, report, places, truths)
    return _found(common, report, causes, truths, key, closed)


def _failed(common: dict[str, Any]) -> Mark:
    kind = common["kind"]
    named = dict.fromkeys(("rank1", "rank3", "place", "is_set", "exact"), False)
    common |= {"answer": "failed", "first": "failed", "superfluous": 0}
    wrong: dict[str, dict[str, Any]] = {
        "none": {"alarm": True},
        "excluded": {"recognized": False, "place": False},
    }
    marks: dict[str, Any] = wrong.get(kind, {**named, "closed": 0.0})
    return Mark(**common, **marks, reason="the diagnosis failed")


def _excluded(
    common: dict[str, Any], report: Mapping[str, Any], places: Places, truths: list[Named]
) -> Mark:
    """Of a removed effect: is it admitted that it is not explained, and is the place right?"""
    recognized = report["verdict"] not in ("explained", "no_gap")
    top = places.of(report["where"][0]["joint"]) if report["where"] else None
    place = top in [where for _, where in truths]
    reason = "" if recognized else f"called {report['verdict']}"
    reason = reason or ("" if place else f"most of the gap put at {top}")
    return Mark(**common, recognized=recognized, place=place, reason=reason)


def _found(
    common: dict[str, Any],
    report: Mapping[str, Any],
    causes: list[list[Named]],
    truths: list[Named],
    key: Mapping[str, Any],
    closed: float | None,
) -> Mark:
    """Of one or two hidden effects: are they named, and where?"""
    first = causes[0] if causes else []
    rank1 = bool(set(first) & set(truths))
    seen = {name for members in causes[:3] for name in members}
    spots = {where for _, where in truths}
    lead = report["causes"][0] if causes else None
    at = first[0][1] if first else None
    place = rank1 or (lead is not None and at in spots)
    error, covered = value_of(lead, first, key["truths"], truths) if lead else (None, None)
    return Mark(
        **common,
        rank1=rank1,
        rank3=set(truths) <= seen,
        place=place,
        closed=closed,
        error=error,
        covered=covered,
        confidence=lead["confidence"] if lead else None,
        right=rank1 if lead else None,
        **_ambiguity(report, causes, truths),
        reason=_why(report, first, truths, rank1, place),
    )


def _ambiguity(
    report: Mapping[str, Any], causes: list[list[Named]], truths: list[Named]
) -> dict[str, Any]:
    """Return whether an answer is a set, and whether it holds, or is, the truth."""
    every = {name for members in causes for name in members}
    inside = set(truths) <= every
    others = [other for cause in report["causes"] for other in cause["equivalent"]]
    if any(not other.get("inseparable") for other in others):
        return {"is_set": True, "inside": inside}
    needed = all(set(members) & set(truths) for members in causes)
    return {"is_set": False, "exact": inside and needed}


def _why(
    report: Mapping[str, Any], first: list[Named], truths: list[Named], rank1: bool, place: bool
) -> str:
    if rank1:
        return ""
    if not report["causes"]:
        return f"no cause named, {report['verdict']}"
    if not first:
        return f"a set of {len(report['causes'][0]['equivalent']) + 1} effects"
    if set(truths) & {(c["effect"], c["where"]) for c in report["causes"]}:
        return "the right effect, but not first"
    return "another effect at the right place" if place else "another effect, another place"


class Places:
    """Makes the names of places comparable: bodies become joints, a lone joint the robot."""

    def __init__(self, joints: Sequence[str], bodies: Mapping[str, str]) -> None:
        """Take the robot's joints, and the joint that moves each body."""
        self._joints, self._bodies = joints, bodies

    def of(self, where: str | None) -> str | None:
        """Return the joint of a place; None for the whole robot."""
        where = self._bodies.get(where, where) if where else where
        return None if len(self._joints) == 1 and where in self._joints else where


def members_of(cause: Mapping[str, Any], places: Places) -> list[Named]:
    """Return a cause and its equivalents; nothing if these are more than a set may hold."""
    every = [cause, *cause["equivalent"]]
    found = [(one["effect"], places.of(one["where"])) for one in every]
    size = sum(not one.get("inseparable") for one in every)
    return found if size <= LARGEST_SET else []


def _first(report: Mapping[str, Any], causes: list[list[Named]], truths: list[Named]) -> str:
    """Return the effect at rank 1: a hidden one if the set holds it; else the verdict."""
    if not causes:
        return report["verdict"]
    right = [effect for effect, where in causes[0] if (effect, where) in truths]
    return right[0] if right else report["causes"][0]["effect"]


def value_of(
    cause: Mapping[str, Any],
    members: list[Named],
    entries: Sequence[Mapping[str, Any]],
    truths: list[Named],
) -> tuple[float | None, bool | None]:
    """Return the relative error of a value and whether its interval covers the truth."""
    if not members or members[0] not in truths or cause["effect"] not in COMPARABLE:
        return None, None
    truth = entries[truths.index(members[0])]
    if truth["side"] != cause["side"] or cause["value"] is None:
        return None, None
    wanted, got = truth["value"], cause["value"]
    low, high = cause["value_ci"]
    covered = None if low is None or high is None else bool(low <= wanted <= high)
    if EFFECTS[cause["effect"]].hows[0] == "scale":  # factors are compared as logarithms
        return abs(math.log(max(got, 1e-9) / wanted) / math.log(wanted)), covered
    return abs(got - wanted) / abs(wanted), covered


def describe(truth: Mapping[str, Any]) -> str:
    """Return a hidden effect in words: `backlash at elbow (link) 0.0341`."""
    where = f" at {truth['where']}" if truth["where"] else ""
    side = f" ({truth['side']})" if truth["side"] else ""
    values = truth["value"] if isinstance(truth["value"], list) else [truth["value"]]
    return f"{truth['effect']}{where}{side} {' '.join(f'{v:.3g}' for v in values)}"


def words(report: Mapping[str, Any]) -> str:
    """Return an answer in words: the verdict and the first three causes with their sets.

    Of fitted values, their number.
    """
    if report.get("fitted"):
        return f"{report['verdict']}: {len(report['fitted'])} values"
    parts = []
    for cause in report["causes"][:3]:
        others = "".join(f" = {o['effect']}@{o['where']}" for o in cause["equivalent"])
        parts.append(f"{describe(cause)}{others}")
    return f"{report['verdict']}: {'; '.join(parts)}" if parts else report["verdict"]


def wilson(hits: Iterable[bool]) -> Interval | None:
    """Return a share and its 95 % interval by Wilson (1927); None of nothing."""
    hits = list(hits)
    if not hits:
        return None
    found = stats.binomtest(sum(hits), len(hits)).proportion_ci(LEVEL, method="wilson")
    return Interval(sum(hits) / len(hits), float(found.low), float(found.high))


def median(values: Iterable[float], rng: np.random.Generator) -> Interval | None:
    """Return a median and its 95 % interval by the bootstrap over cases; None of nothing.

    A single case has no interval but itself.
    """
    found = np.array(list(values), float)[:, None]  # (n, 1)
    if not len(found):
        return None
    if len(found) == 1:
        return Interval(*np.repeat(found, 3).tolist())
    return bootstrap(found, statistics.median, rng, draws=DRAWS, resample="rows", level=LEVEL)


def of(marks: Sequence[CaseMark], name: str) -> list[Any]:
    """Return one question's marks where it applies."""
    return [value for one in marks if (value := getattr(one, name)) is not None]


def summary(marks: Sequence[Mark], rng: np.random.Generator) -> Table:
    """Return the figures of an exam, each with its number of cases, interval and aim."""
    table = Table(("figure", "cases", "value", "aim"))
    shown = [one for one in marks if one.kind in ("one", "two")]

    def add(label: str, values: Sequence[Any], aim: str, kind: Callable[..., Any] = wilson) -> None:
        table.add(label, len(values), kind(values), aim)

    def middle(values: Sequence[float]) -> Interval | None:
        return median(values, rng)

    add("rank 1 right", of(shown, "rank1"), "≥ 0.90")
    add("all among the first three", of(shown, "rank3"), "")
    add("place right", of(shown, "place"), "≥ 0.95")
    add("closed on the sealed log, median", of(shown, "closed"), "≥ 0.90", middle)
    add("closed as reported, median", of(shown, "claimed"), "", middle)
    add("false alarms where nothing is hidden", of(marks, "alarm"), "≤ 1 case")
    excluded = [one for one in marks if one.kind == "excluded"]
    both = [bool(one.recognized and one.place) for one in excluded]
    add("removed effect: not explained and place right", both, "≥ 0.90")
    add("removed effect: not explained", of(excluded, "recognized"), "")
    add("removed effect: place right", of(excluded, "place"), "")
    add("value in its 90 % interval", of(shown, "covered"), "0.75 to 0.97")
    add("relative error of values, median", of(shown, "error"), "", middle)
    add("superfluous causes, mean", of(shown, "superfluous"), "≤ 0.05", mean)
    add("answers that are sets", of(shown, "is_set"), "≤ 0.30")
    add("the truth inside these sets", of(shown, "inside"), "≥ 0.98")
    add("without equivalents, exactly right", of(shown, "exact"), "≥ 0.90")
    add("seconds a case, median", of(marks, "seconds"), "≤ 180", middle)
    for kind in ("one", "two"):
        own = [one for one in shown if one.kind == kind]
        add(f"rank 1 right, {kind} hidden", of(own, "rank1"), "")
    for robot in dict.fromkeys(one.robot for one in shown):
        own = [one for one in shown if one.robot == robot]
        add(f"rank 1 right, {robot}", of(own, "rank1"), "")
    names = ", ".join(COMPARABLE)
    table.notes.append(f"Brackets: 95 % intervals. Values are compared for {names}.")
    return table


def mean(values: Sequence[float] | np.ndarray) -> float | None:
    """Return the mean, or None of an empty sequence."""
    return float(np.mean(values)) if len(values) else None


def calibration(marks: Sequence[CaseMark]) -> Table:
    """Return how often the first cause is right, by the confidence that it was named with."""
    table = Table(("confidence", "cases", "mean confidence", "right"))
    said, right = confidences(marks)
    for low, high in pairwise(EDGES):
        own = (low <= said) & (said < high)
        words = f"{low:g} to {min(high, 1.0):g}"
        table.add(words, int(own.sum()), mean(said[own]), wilson(right[own].tolist()))
    if len(said):
        brier = np.mean((said - right) ** 2)
        table.notes.append(f"Brier score {brier:.3f} (0 is best, 0.25 is a coin's).")
    return table


def confidences(marks: Sequence[CaseMark]) -> tuple[np.ndarray, np.ndarray]:
    """Return the confidences of first causes, (N,), and which of these are right, (N,) bool."""
    asked = [one for one in marks if one.right is not None]
    said = np.array([one.confidence or 0.0 for one in asked], float)
    return said, np.array([one.right for one in asked], bool)


def failures(marks: Sequence[CaseMark], *sizes: str) -> Table:
    """Return the cases that were answered wrongly, and how; `sizes` are further numbers of them."""
    table = Table(("case", "robot", "kind", *sizes, "hidden", "answer", "why"))
    for one in marks:
        if one.reason:
            numbers = (round(getattr(one, name), 1) for name in sizes)
            told = (one.hidden, one.answer, one.reason)
            table.add(one.case, one.robot, one.kind, *numbers, *told)
    return table


def cases(marks: Sequence[Any]) -> Table:
    """Return every case of an exam with all its marks."""
    names = [name for name in type(marks[0]).__dataclass_fields__ if name != "truths"]
    table = Table(names)
    for one in marks:
        values = [getattr(one, name) for name in names]
        table.add(*(int(v) if isinstance(v, bool) else v for v in values))
    return table
