"""Marks of one case of the exam on other engines: an answer against its key.

    one = mark(key, report, closed=0.97)

Rules, in addition to those of `sim2real.exam.score`:

* Rank 1 and place are asked wherever something of the vocabulary is hidden; under a dirty
  background of the dominant effect.
* `explained` is right for one or two effects of the vocabulary. The verdict `fitted` counts as not
  explained, and so does a diagnosis that failed.
* A law outside the vocabulary must not be `explained`, and most of the gap must be put at its
  joint. A loose mount has no joint; its place is not asked.
* Where only the nominal model is off, a single cause with a confidence of 0.8 or more is too sure.
  The first cause is right if that number is off in its direction and about as far.
* A robot-wide effect is right at rank 1 if it is named as one for the robot: its place is none, or
  the report calls it shared.
* The confidence of a first cause is held against whether that cause is right; of an outside law
  none is.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sim2real.exam.score import CaseMark, Named, Places, describe, members_of, value_of, words
from sim2real.exam.thirdparty.deviations import names_deviation

SURE = 0.8  # confidence from which a cause that is none counts as wrong


@dataclass(frozen=True, kw_only=True)
class Mark(CaseMark):
    """The result of one case; see `CaseMark`, and `sim2real.exam.thirdparty.kinds`."""

    truths: tuple[str, ...]  # the names of what was hidden
    verdict: str  # of the report; "failed" without one
    floors: float  # the gap in floors
    background: float  # the gap of what is a little off everywhere, in floors
    explained: bool | None = None  # whether the verdict is `explained`
    sure: bool | None = None  # whether a cause was named with a confidence of `SURE` or more


def mark(
    key: Mapping[str, Any], report: Mapping[str, Any] | None, closed: float | None = None
) -> Mark:
    """Compare an answer, None of a failed diagnosis, with its key; `closed`: see `CaseMark`."""
    truths = key["truths"]
    hidden = ", ".join(_words(truth) for truth in truths) or "nothing; the nominal model is off"
    common = {
        "case": key["name"],
        "kind": key["kind"],
        "robot": key["robot"],
        "hidden": hidden,
        "truths": tuple(truth["effect"] for truth in truths),
        "floors": key["gap"] / key["floor"],
        "background": key["background"] / key["floor"],
        "verdict": report["verdict"] if report else "failed",
        "answer": words(report) if report else "failed",
        "seconds": report["seconds"] if report else None,
        "closed": closed,
    }
    if key["kind"] == "off_nominal":
        return _off(common, key, report)
    if key["kind"] == "outside":
        return _outside(common, key, report)
    return _inside(common, key, report)


def _words(truth: Mapping[str, Any]) -> str:
    shared = " of all joints" if truth.get("shared") else ""
    encoder = f", log's encoder {truth['encoder']}" if truth.get("encoder") else ""
    return f"{describe(truth)}{shared}{encoder}"


def _causes(report: Mapping[str, Any] | None) -> list[Mapping[str, Any]]:
    return list(report["causes"]) if report else []


def _first(causes: list[Mapping[str, Any]], right: bool) -> dict[str, Any]:
    if not causes:
        return {}
    return {"confidence": causes[0]["confidence"], "right": right}


def _off(common: dict[str, Any], key: Mapping[str, Any], report: Mapping[str, Any] | None) -> Mark:
    causes, places = _causes(report), Places(key["joints"], key["bodies"])
    true = [names_deviation(cause, places, key["deviations"]) for cause in causes]
    sure = len(causes) == 1 and causes[0]["confidence"] >= SURE
    reason = "a single cause with high confidence" if sure else "" if report else "failed"
    marks = {"rank1": true[0], **_first(causes, true[0])} if causes else {}
    return Mark(**common, **marks, sure=sure, superfluous=true.count(False), reason=reason)


def _outside(
    common: dict[str, Any], key: Mapping[str, Any], report: Mapping[str, Any] | None
) -> Mark:
    causes, joint = _causes(report), key["truths"][0]["joint"]
    explained = common["verdict"] == "explained"
    top = report["where"][0]["joint"] if report and report["where"] else None
    place = None if joint is None else top == joint
    reason = "" if report else "failed"
    reason = "called explained" if explained else reason
    reason = reason or (f"most of the gap put at {top}" if place is False else "")
    marks = {"explained": explained, "place": place, "superfluous": len(causes), "reason": reason}
    return Mark(**common, **_first(causes, False), **marks)


def _inside(
    common: dict[str, Any], key: Mapping[str, Any], report: Mapping[str, Any] | None
) -> Mark:
    places = Places(key["joints"], key["bodies"])
    wide = key["kind"] == "robot_wide"
    truths = [(truth["effect"], places.of(truth["joint"])) for truth in key["truths"]]
    causes = _causes(report)
    named = [members_of(cause, places) for cause in causes]
    if wide:
        named = [_as_wide(cause, own) for cause, own in zip(causes, named, strict=True)]
    first = named[0] if named else []
    rank1 = bool(set(first) & set(truths))
    spots = {where for _, where in truths}
    lead = causes[0] if causes else None
    place = rank1 or (lead is not None and not wide and places.of(lead["where"]) in spots)
    error, covered = value_of(lead, first, key["truths"], truths) if lead else (None, None)
    marks = {
        "rank1": rank1,
        "rank3": set(truths) <= {name for members in named[:3] for name in members},
        "place": None if wide else place,
        "explained": common["verdict"] == "explained",
        "error": error,
        "covered": covered,
        "superfluous": sum(not set(members) & set(truths) for members in named),
        "reason": _why(common["verdict"], causes, named, truths, rank1, bool(place)),
    }
    return Mark(**common, **_first(causes, rank1), **marks)


def _as_wide(cause: Mapping[str, Any], members: list[Named]) -> list[Named]:
    """Return the members of a cause that are effects of the whole robot."""
    if cause.get("shared"):
        return [(effect, None) for effect, _ in members]
    return [(effect, where) for effect, where in members if where is None]


def _why(
    verdict: str,
    causes: list[Mapping[str, Any]],
    named: list[list[Named]],
    truths: list[Named],
    rank1: bool,
    place: bool,
) -> str:
    if rank1:
        return ""
    if not causes:
        return f"no cause named, {verdict}"
    if any(set(members) & set(truths) for members in named):
        return "the right effect, but not first"
    effects = {effect for effect, _ in truths}
    if any(cause["effect"] in effects for cause in causes):
        return "the right effect, another place"
    return "another effect at the right place" if place else "another effect, another place"
