"""Scoring: made-up answers against made-up keys, rule by rule."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2real.exam import matrix
from sim2real.exam.score import Mark, calibration, cases, failures, mark, median, summary, wilson

JOINTS, BODIES = ["shoulder", "elbow"], {"upper": "shoulder", "fore": "elbow"}


def truth(effect: str, joint: str | None, value: float = 0.05, **more: Any) -> dict[str, Any]:
    """Return a hidden effect as a key has it."""
    return {"effect": effect, "where": joint, "joint": joint, "side": None, "value": value} | more


def key(*truths: dict[str, Any], kind: str | None = None, joints: Any = JOINTS) -> dict[str, Any]:
    """Return a key."""
    kind = kind or ("none", "one", "two")[len(truths)]
    common = {"name": "case_000", "kind": kind, "robot": "arm", "bodies": BODIES}
    return {**common, "truths": list(truths), "joints": joints}


def cause(effect: str, where: str | None, *equal: tuple[str, str | None]) -> dict[str, Any]:
    """Return a cause of a report, with its equivalents."""
    others = [{"effect": e, "where": w} for e, w in equal]
    value = {"value": 0.051, "value_ci": [0.049, 0.053], "confidence": 0.9}
    return {"effect": effect, "where": where, "side": None, "equivalent": others, **value}


def answer(*causes: dict[str, Any], verdict: str = "explained") -> dict[str, Any]:
    """Return a report."""
    gap = {"closed": 0.95}
    where = [{"joint": "elbow", "share": 0.9}, {"joint": "shoulder", "share": 0.1}]
    base = {"verdict": verdict, "gap": gap, "where": where, "seconds": 20.0}
    return base | {"causes": list(causes)}


def test_the_right_effect_at_the_right_place() -> None:
    """Named first, it is right; its value is compared and its interval checked."""
    one = mark(key(truth("backlash", "elbow")), answer(cause("backlash", "elbow")), 0.97)
    assert (one.rank1, one.rank3, one.place, one.covered, one.reason) == (True,) * 4 + ("",)
    assert one.error == pytest.approx(0.02)
    assert (one.closed, one.claimed, one.superfluous) == (0.97, 0.95, 0)


def test_the_right_effect_at_another_joint_is_wrong() -> None:
    """An effect is what it is where it is."""
    one = mark(key(truth("backlash", "elbow")), answer(cause("backlash", "shoulder")), None)
    assert (one.rank1, one.place, one.reason) == (False, False, "another effect, another place")


@pytest.mark.parametrize(("size", "right"), [(2, True), (3, True), (4, False)])
def test_a_set_counts_up_to_three_members(size: int, right: bool) -> None:
    """The cause is one of the three; a set that names everything says nothing."""
    others = [("dead_zone", "elbow"), ("cogging", "elbow"), ("armature", "elbow")][-(size - 1) :]
    named = cause("coulomb_friction", "elbow", *others)
    one = mark(key(truth("armature", "elbow")), answer(named), None)
    assert one.rank1 is right


def test_second_and_third_causes_count_for_rank_three() -> None:
    """Rank 1 is missed, rank 3 is not."""
    said = answer(cause("cogging", "elbow"), cause("backlash", "elbow"))
    one = mark(key(truth("backlash", "elbow")), said, None)
    assert (one.rank1, one.rank3, one.superfluous) == (False, True, 1)
    assert one.reason == "the right effect, but not first"


def test_of_two_hidden_effects_one_comes_first_and_both_among_three() -> None:
    """Either may be first; rank 3 wants both."""
    both = key(truth("backlash", "elbow"), truth("command_delay", None))
    one = mark(both, answer(cause("command_delay", None)), None)
    assert (one.rank1, one.rank3) == (True, False)
    said = answer(cause("command_delay", None), cause("backlash", "elbow"))
    assert mark(both, said, None).rank3


def test_a_body_is_the_joint_that_moves_it() -> None:
    """A report says `elbow` or `fore`: it is the same place."""
    hidden = truth("link_mass", "elbow") | {"where": "fore"}
    for where in ("elbow", "fore"):
        assert mark(key(hidden), answer(cause("link_mass", where)), None).rank1


def test_a_robot_of_one_joint_has_one_place() -> None:
    """Its joint and the whole robot are the same."""
    bench = key(truth("motor_strength", "shoulder"), joints=["shoulder"])
    assert mark(bench, answer(cause("motor_strength", None)), None).rank1


def test_what_no_recording_parts_is_one_member_of_a_set() -> None:
    """Four names of which two are one are three members; four are too many."""
    equal = [("motor_strength", None), ("supply_voltage", None), ("backlash", "elbow")]
    large = cause("position_gain", "elbow", *equal)
    asked = key(truth("backlash", "elbow"))
    assert not mark(asked, answer(large), 0.97).rank1
    large["equivalent"][1]["inseparable"] = True
    assert mark(asked, answer(large), 0.97).rank1


def test_a_set_is_what_another_recording_could_part() -> None:
    """It is asked whether it holds all of the truth; an answer that is none, whether it is it."""
    asked = key(truth("armature", "elbow"), truth("command_delay", None))
    delay = cause("command_delay", None, ("observation_delay", None))
    small = cause("cogging", "elbow", ("armature", "elbow"))

    def said(*causes: dict[str, Any]) -> tuple[bool | None, ...]:
        one = mark(asked, answer(*causes), None)
        return one.is_set, one.inside, one.exact

    assert said(delay, small) == (True, True, None)
    assert said(delay) == (True, False, None)
    for named in (delay, small):
        named["equivalent"][0]["inseparable"] = True
    assert said(delay, small) == (False, None, True)
    assert said(delay) == (False, None, False)
    assert said(delay, small, cause("backlash", "elbow")) == (False, None, False)
    assert said() == (False, None, False)
    failed = mark(asked, None, None)
    assert (failed.is_set, failed.inside, failed.exact) == (False, None, False)
    assert mark(key(), answer(verdict="no_gap"), None).is_set is None


def test_fitted_values_name_nothing() -> None:
    """Ten values that follow the robot are no cause, right or wrong, and explain nothing away."""
    values = [cause("position_gain", f"joint{n}") for n in range(9)]
    fitted = {**answer(verdict="fitted"), "fitted": [*values, cause("backlash", "elbow")]}
    one = mark(key(truth("backlash", "elbow")), fitted, 0.95)
    assert (one.rank1, one.rank3, one.superfluous, one.confidence) == (False, False, 0, None)
    assert (one.answer, one.reason) == ("fitted: 10 values", "no cause named, fitted")
    gone = mark(key(truth("backlash", "elbow"), kind="excluded"), fitted, None)
    assert (gone.recognized, gone.place) == (True, True)


@pytest.mark.parametrize(("verdict", "alarm"), [("no_gap", False), ("partly_explained", True)])
def test_nothing_hidden(verdict: str, alarm: bool) -> None:
    """Only no_gap is right."""
    assert mark(key(), answer(verdict=verdict), None).alarm is alarm


@pytest.mark.parametrize(
    ("verdict", "joint", "recognized", "place"),
    [
        ("unexplained", "elbow", True, True),
        ("partly_explained", "elbow", True, True),
        ("explained", "elbow", False, True),
        ("no_gap", "elbow", False, True),
        ("unexplained", "shoulder", True, False),
    ],
)
def test_a_removed_effect(verdict: str, joint: str, recognized: bool, place: bool) -> None:
    """It must not be explained away, and the joint with the largest share is its place."""
    one = mark(key(truth("backlash", joint), kind="excluded"), answer(verdict=verdict), None)
    assert (one.recognized, one.place) == (recognized, place)
    assert (one.reason == "") == (recognized and place)


def test_a_diagnosis_that_fails_is_wrong() -> None:
    """In every kind of case."""
    assert mark(key(), None, None).alarm
    assert mark(key(truth("backlash", "elbow")), None, None).rank1 is False
    assert mark(key(truth("backlash", "elbow"), kind="excluded"), None, None).recognized is False


def test_factors_are_compared_by_their_logarithms() -> None:
    """A gain of 0.5 found as 0.25 is off by as much as the gain itself."""
    named = cause("position_gain", "elbow") | {"value": 0.25, "value_ci": [0.2, 0.3]}
    one = mark(key(truth("position_gain", "elbow", 0.5)), answer(named), None)
    assert (one.error, one.covered) == (pytest.approx(1.0), False)


def test_wilson_interval_of_nine_in_ten() -> None:
    """Brown, Cai and DasGupta 2001, table of Wilson intervals: 0.596 to 0.982."""
    found = wilson([True] * 9 + [False])
    assert found == pytest.approx((0.9, 0.5958, 0.9821), abs=1e-4)
    assert wilson([]) is None


def test_median_interval_holds_the_median() -> None:
    """And is no wider than the values."""
    found = median([0.8, 0.9, 0.95, 1.0], np.random.default_rng(0))
    assert found is not None
    assert found.value == pytest.approx(0.925)
    assert 0.8 <= found.low <= found.value <= found.high <= 1.0


def marks() -> list[Mark]:
    """Return a right answer, a wrong one, and a right one to nothing."""
    right = mark(key(truth("backlash", "elbow")), answer(cause("backlash", "elbow")), 1.0)
    wrong = mark(key(truth("backlash", "elbow")), answer(cause("cogging", "elbow")), 0.5)
    quiet = mark(key(), answer(verdict="no_gap"), None)
    return [right, wrong, quiet]


def test_tables_of_an_exam(tmp_path: Path) -> None:
    """Figures, calibration and failures come from the same marks."""
    rows = {row[0]: row for row in summary(marks(), np.random.default_rng(0)).rows}
    assert rows["rank 1 right"][1:3] == (2, wilson([True, False]))
    assert rows["false alarms where nothing is hidden"][2] == wilson([False])
    assert [row[5] for row in failures(marks()).rows] == ["another effect at the right place"]
    assert len(cases(marks()).rows) == 3
    by = calibration(marks())
    assert [row[1] for row in by.rows] == [0, 0, 0, 2, 0]
    assert "Brier score 0.410" in by.notes[0]  # ((1 - 0.9)² + 0.9²) / 2


def test_the_confusion_matrix(tmp_path: Path) -> None:
    """What is right lies on the diagonal, nothing hidden and no_gap included."""
    counts = matrix.confusion(marks())
    assert counts.hidden == ["backlash", "nothing"]
    assert counts.named == ["backlash", "no_gap", "cogging"]
    assert counts.counts.tolist() == [[1, 0, 1], [0, 1, 0]]
    assert "| backlash | 1 | – | 1 |" in matrix.table(counts).markdown()
    matrix.draw(counts, tmp_path / "matrix.png")
    assert (tmp_path / "matrix.png").stat().st_size > 5000
