"""Marks of the exam on other engines: each kind's rule, and the tables."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2real.exam.score import failures
from sim2real.exam.thirdparty import tables
from sim2real.exam.thirdparty.marks import Mark, mark

JOINTS = ["yaw", "shoulder", "elbow"]


def key(kind: str, *truths: dict[str, Any]) -> dict[str, Any]:
    """Return a key with truths of (effect, joint) and more."""
    plain = {"side": None, "value": 0.5, "extra": {}}
    full = [{**plain, "where": t["joint"], **t} for t in truths]
    about = {"name": "case_000", "kind": kind, "robot": "arm3", "gap": 0.01, "floor": 0.001}
    bodies = {"upper": "shoulder", "forearm": "elbow"}
    about |= {"background": 0.0, "truths": full, "joints": JOINTS, "bodies": bodies}
    return about | {"deviations": [{**FRICTION, "value": 0.3}]}


def report(verdict: str, *causes: dict[str, Any], top: str = "elbow") -> dict[str, Any]:
    """Return a report with causes of (effect, where) and more."""
    plain = {"side": None, "value": 0.5, "value_ci": [0.4, 0.6], "confidence": 0.9, "extra": {}}
    full = [{**plain, "equivalent": [], **cause} for cause in causes]
    return {"verdict": verdict, "causes": full, "where": [{"joint": top}], "seconds": 60.0}


FRICTION = {"effect": "coulomb_friction", "joint": "elbow"}
FOUND = {"effect": "coulomb_friction", "where": "elbow"}


def test_a_single_effect() -> None:
    """Effect and place make rank 1; the interval and the verdict are asked beside it."""
    one = mark(key("single", FRICTION), report("explained", FOUND))
    assert (one.rank1, one.place, one.explained, one.covered, one.right) == (True,) * 5
    assert one.superfluous == 0
    assert one.reason == ""
    off = mark(key("single", FRICTION), report("explained", {**FOUND, "where": "yaw"}))
    assert (off.rank1, off.place, off.right) == (False, False, False)
    assert off.reason == "the right effect, another place"


@pytest.mark.parametrize("verdict", ["fitted", "unexplained"])
def test_fitted_is_not_explained(verdict: str) -> None:
    """Without causes nothing is named, nothing explained, and nothing was claimed."""
    one = mark(key("single", FRICTION), report(verdict))
    assert (one.rank1, one.explained, one.right) == (False, False, None)
    outside = mark(key("outside", {"effect": "cable", "joint": "elbow"}), report(verdict))
    assert outside.explained is False
    assert outside.place is True
    assert outside.reason == ""


def test_an_outside_law_must_not_be_explained() -> None:
    """A verdict of `explained` is wrong at any place, and its confidence was misplaced."""
    truth = {"effect": "cable", "joint": "elbow"}
    one = mark(key("outside", truth), report("explained", FOUND))
    assert (one.explained, one.right) == (True, False)
    assert one.reason == "called explained"
    assert mark(key("outside", truth), report("unexplained", top="yaw")).place is False
    mount = {"effect": "loose_mount", "joint": None}
    assert mark(key("outside", mount), report("unexplained")).place is None


def test_where_only_the_model_is_off_nobody_may_be_sure() -> None:
    """One sure cause is wrong; two, an unsure one and none are not."""
    sure = [
        mark(key("off_nominal"), answer).sure
        for answer in (
            report("explained", FOUND),
            report("explained", {**FOUND, "confidence": 0.7}),
            report("explained", FOUND, {**FOUND, "where": "yaw"}),
            report("no_gap"),
            None,
        )
    ]
    assert sure == [True, False, False, False, False]


def test_where_the_model_is_off_what_is_named_may_be_true() -> None:
    """The number is off in that direction and about as far: else it is superfluous."""
    report_of = partial(report, "explained")
    true, far, wrong = (
        mark(key("off_nominal"), report_of({**FOUND, "value": value})) for value in (0.4, 0.7, -0.3)
    )
    assert (true.rank1, true.right, true.superfluous) == (True, True, 0)
    assert (far.rank1, far.right, far.superfluous) == (False, False, 1)
    assert (wrong.rank1, wrong.right, wrong.superfluous) == (False, False, 1)
    assert mark(key("off_nominal"), report("no_gap")).rank1 is None


def test_robot_wide_is_asked_for_as_such() -> None:
    """A shared cause is right, the same effect at one joint is not."""
    truth = {"effect": "coulomb_friction", "joint": None, "shared": True}
    shared = {**FOUND, "where": None, "shared": True}
    assert mark(key("robot_wide", truth), report("explained", shared)).rank1 is True
    at_a_joint = mark(key("robot_wide", truth), report("explained", FOUND))
    assert at_a_joint.rank1 is False
    assert at_a_joint.reason == "the right effect, another place"


def test_a_failed_diagnosis_is_wrong() -> None:
    """It names nothing and explains nothing."""
    one = mark(key("dirty", FRICTION), None)
    assert (one.rank1, one.place, one.explained) == (False, False, False)
    assert one.reason == "no cause named, failed"


def test_calibration_error() -> None:
    """Nine of ten right at 0.9 is none; none right at 0.9 is all of it."""

    def marks(rights: list[bool]) -> list[Mark]:
        made = [mark(key("single", FRICTION), report("explained", FOUND)) for _ in rights]
        return [
            Mark(**{**vars(one), "right": right}) for one, right in zip(made, rights, strict=True)
        ]

    assert tables.calibration_error(marks([True] * 9 + [False])) == pytest.approx(0, abs=1e-12)
    assert tables.calibration_error(marks([False] * 4)) == pytest.approx(0.9)
    assert tables.calibration_error([]) is None


def test_a_false_explanation_has_a_line_of_its_own() -> None:
    """A wrong first cause, or a law outside, that is called explained; what is open is none."""
    marks = [
        mark(key("single", FRICTION), report("explained", FOUND)),
        mark(key("single", FRICTION), report("explained", {**FOUND, "where": "yaw"})),
        mark(key("outside", {"effect": "cable", "joint": "elbow"}), report("explained", FOUND)),
        mark(key("single", FRICTION), report("partly_explained", {**FOUND, "where": "yaw"})),
    ]
    rows: dict[Any, Any] = {row[0]: row[1:3] for row in tables.lines(marks).rows}
    count, share = rows["of all called explained: a false first cause"]
    assert count == 3
    assert share.value == pytest.approx(2 / 3)


def test_tables_count_each_effect_in_each_kind(tmp_path: Path) -> None:
    """Recall says right of asked; the picture is drawn; failures are listed one by one."""
    marks = [
        mark(key("single", FRICTION), report("explained", FOUND)),
        mark(key("single", FRICTION), report("no_gap")),
        mark(key("outside", {"effect": "cable", "joint": "elbow"}), report("unexplained")),
    ]
    rows = {row[0]: row[1:] for row in tables.recall(marks).rows}
    assert rows == {"cable": (None, "1 of 1"), "coulomb_friction": ("1 of 2", None)}
    assert len(failures(marks, "floors").rows) == 1
    figures = {row[0]: row[1] for row in tables.lines(marks).rows}
    assert figures["single: rank 1 right"] == 2
    kinds = tables.by_kind(marks, np.random.default_rng(0)).rows
    assert [row[:2] for row in kinds] == [("single", 2), ("outside", 1), ("all", 3)]
    tables.draw(marks, tmp_path / "recall.png")
    assert (tmp_path / "recall.png").stat().st_size > 1000
