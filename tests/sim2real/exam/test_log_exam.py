"""The exam of log mistakes: a balanced draw, folders that keep the secret, marks."""

import json
from collections import Counter
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from hardware.log import read_log
from sim2real.exam.hold import KEY, Outline
from sim2real.exam.log_exam import BESIDE, LogExam, LogMark, mark, shows, summary
from sim2real.exam.log_mistakes import KINDS, PAIRED, Mistake, draw_mistake
from sim2real.exam.logs import drive, exam_robot, plans
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.statistics import Interval

EXAM = LogExam(["bench1", "arm2", "hopper2", "pair2"], 60, 15, longest=60.0, block=60)


def test_kinds_and_robots_come_equally_often() -> None:
    """A quarter of the cases hides an effect; no mistake of two joints has a robot of one."""
    drawn = EXAM.draw(1)
    kinds = Counter(one.kind for one in drawn)
    assert set(kinds) == set(KINDS)
    assert max(kinds.values()) - min(kinds.values()) <= 1
    assert all(one.robot != "bench1" for one in drawn if one.kind in PAIRED)
    assert min(Counter(one.robot for one in drawn).values()) >= 8
    hidden = [one.effects[0] for one in drawn if one.effects]
    assert len(hidden) == 15 == len(set(hidden)) and set(hidden) <= set(BESIDE)
    assert EXAM.draw(1) == drawn != EXAM.draw(2)


@pytest.mark.parametrize("wrong", [{"robots": []}, {"count": 0}, {"beside": 61}, {"block": 0}])
def test_an_exam_that_cannot_be_drawn_is_refused(wrong: dict) -> None:
    """With its numbers."""
    given: dict[str, Any] = {"robots": ["arm2"], "count": 60, "beside": 15}
    with pytest.raises(Sim2RealError, match=r"cannot be drawn|block=0"):
        LogExam(**(given | {"longest": 60.0, "block": 60} | wrong))


def test_a_mistake_that_no_log_shows_is_not_hidden(tmp_path: Path) -> None:
    """Both columns of a hanging pendulum reversed are its mirror image's, which moves alike.

    One column alone shows, and so do both of an elbow whose shoulder is not reversed with it.
    """
    both = ("ctrl", "qpos")
    for name, joint, shown in (("bench1", "hinge", False), ("arm2", "elbow", True)):
        robot = exam_robot(name, tmp_path)
        log = drive(robot, [], plans(robot, 1)["a_again"], 3)
        spec = mujoco.MjSpec.from_file(str(robot.model))
        assert shows(Mistake("reversal", both, joint, -1.0), log, spec) is shown
        for column in both:
            assert shows(Mistake("reversal", (column,), joint, -1.0), log, spec)


def test_what_no_log_shows_is_drawn_again_when_a_case_is_made(tmp_path: Path) -> None:
    """A seed that draws both columns of the pendulum first leaves one of them in the case."""
    logs, keys = tmp_path / "logs", tmp_path / "key"
    logs.mkdir()
    keys.mkdir()
    robot = exam_robot("bench1", tmp_path)
    log = drive(robot, [], plans(robot, 1)["a_again"], 3)
    first = {s: draw_mistake(np.random.default_rng([s, 4]), log, "reversal") for s in range(20)}
    seed = next(seed for seed, one in first.items() if one.columns == ("ctrl", "qpos"))
    assert EXAM.make(Outline("mirrored", "reversal", "bench1", (), seed), logs, keys)
    made = Mistake.from_json(json.loads((keys / KEY).read_text())["mistake"])
    assert made.kind == "reversal" and len(made.columns) == 1


TURN = Mistake("turn", ("qpos",), "elbow", 1.0, seconds=4.0)


def key(mistake: Mistake, *truths: dict) -> dict:
    """Return a case's key."""
    joints = ["shoulder", "elbow"]
    tables = {"mistake": mistake.to_json(), "truths": truths}
    return {"name": "case_000", "robot": "arm2", "joints": joints, **tables}


def report(verdict: str, *causes: tuple[str, str, str | None, float]) -> dict:
    """Return an answer; of each cause kind, effect, place and value."""
    tables = [
        {"kind": kind, "effect": effect, "where": where, "side": None, "value": value}
        | {"equivalent": [], "extra": {"columns": ["ctrl"]}}
        for kind, effect, where, value in causes
    ]
    return {"verdict": verdict, "causes": tables, "seconds": 1.0}


@pytest.mark.parametrize(
    ("cause", "named"),
    [
        (("log", "turn", "elbow", 1.0), True),
        (("log", "turn", "shoulder", 1.0), False),
        (("log", "turn", "elbow", -1.0), False),
        (("log", "offset", "elbow", 6.28), False),
        (("robot", "encoder_offset", "elbow", 6.28), False),
    ],
)
def test_a_mistake_is_named_by_kind_place_and_size(cause: tuple, named: bool) -> None:
    """What blames the robot is counted apart."""
    one = mark(key(TURN), report("explained", cause))
    assert one.named == named
    assert one.blamed == (cause[0] == "robot")


def test_an_equivalent_may_be_the_mistake() -> None:
    """As with effects."""
    answer = report("explained", ("log", "offset", "elbow", 6.28))
    answer["causes"][0]["equivalent"] = [{"effect": "turn", "where": "elbow"}]
    assert mark(key(TURN), answer).named


def test_a_mistake_of_all_joints_may_be_named_at_one() -> None:
    """Or of the robot."""
    late = Mistake("row_shift", ("ctrl",), None, 2.0)
    for where in (None, "elbow"):
        answer = report("partly_explained", ("log", "row_shift", where, 2.0))
        assert mark(key(late), answer).named


def test_an_effect_beside_it_is_marked_too() -> None:
    """A report of schema 2 has causes of the robot alone."""
    answer = report("explained", ("robot", "armature", "elbow", 0.1))
    del answer["causes"][0]["kind"]
    one = mark(key(TURN, {"effect": "armature", "where": "elbow", "joint": "elbow"}), answer)
    assert (one.found, one.named, one.blamed) == (True, False, True)
    assert mark(key(TURN), None).answer == "failed"


def test_figures_count_kinds() -> None:
    """Each with its interval."""
    one = LogMark(
        "case_000", "arm2", "turn of qpos.elbow by 1", "", "explained", True, False, None, 1
    )
    rows = {row[0]: row for row in summary([one, one]).rows}
    assert rows["named, turn"][1] == 2
    share = rows["mistake named"][2]
    assert isinstance(share, Interval) and share.value == 1.0


@pytest.mark.slow
def test_a_case_is_made_and_keeps_its_secret(tmp_path: Path) -> None:
    """The log has the mistake; what says which lies elsewhere."""
    outline = Outline("case_000", "turn", "arm2", ("coulomb_friction",), 5)
    logs, keys = tmp_path / "logs", tmp_path / "key"
    assert EXAM.make(outline, logs, keys)
    truth = json.loads((keys / KEY).read_text())
    assert truth["mistake"]["kind"] == "turn"
    assert truth["truths"][0]["effect"] == "coulomb_friction"
    log, joint = read_log(logs / "a.csv"), truth["mistake"]["joint"]
    assert abs(log.column(f"qpos.{joint}")[-1] - log.column(f"ctrl.{joint}")[-1]) > 3
    assert not any(name.startswith(("action.", "sensor.", "current.")) for name in log.columns)
    assert {file.name for file in logs.iterdir()} == {"a.csv", "a.json", "model.xml", "task.json"}


def test_a_late_command_is_an_early_reading() -> None:
    """Of the other sign: no log says which of the two columns was off."""
    late = Mistake("row_shift", ("ctrl",), None, 2.0)
    for column, value, named in (
        ("ctrl", 2.0, True),
        ("qpos", -2.0, True),
        ("ctrl", -2.0, False),
        ("qpos", 2.0, False),
    ):
        answer = report("explained", ("log", "row_shift", None, value))
        answer["causes"][0]["extra"] = {"columns": [column]}
        assert mark(key(late), answer).named == named
