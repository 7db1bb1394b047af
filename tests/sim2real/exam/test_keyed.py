"""The exam of real robots with a published key: what has to be named, and nothing else."""

import json
import os
from pathlib import Path

import pytest

from hardware.log import read_log
from sim2real.config.compose import compose, instantiate
from sim2real.exam.keyed import Keyed, KeyedExam, Wanted, mark
from sim2real.runs.errors import Sim2RealError

DATA = os.environ.get("SIM2REAL_DATA")
ONE = {"log": "a/a.csv", "model": "a/a.xml"}
FRICTION = Wanted(["coulomb_friction"], [None, "elbow"])
PUSH = Wanted(["push"], ["elbow"], [(0, 4.4), (1, 2.8)])


def cause(effect: str, where: str | None, *others: tuple[str, str | None], **more: object) -> dict:
    """Return a cause of a report, with equivalents."""
    equivalent = [{"effect": name, "where": place} for name, place in others]
    plain = {"effect": effect, "where": where, "side": None, "value": 1.0, "extra": {}}
    return plain | {"equivalent": equivalent, "seconds": None} | more


def report(verdict: str, *causes: dict) -> dict:
    """Return a report."""
    return {"verdict": verdict, "causes": list(causes), "seconds": 1.0}


def test_a_cause_or_its_equivalent_counts_and_others_do_not() -> None:
    """What is withheld has to be named; a cause more is marked."""
    case = Keyed("a.csv", "a.xml", [FRICTION])
    right = mark("one", case, report("explained", cause("coulomb_friction", "elbow")))
    assert (right.named, right.alone, right.verdict) == (True, True, True)
    near = cause("viscous_friction", "elbow", ("coulomb_friction", None))
    assert mark("one", case, report("explained", near)).named
    more = report("explained", cause("coulomb_friction", None), cause("armature", "elbow"))
    assert mark("one", case, more).named and not mark("one", case, more).alone
    assert not mark("one", case, report("no_gap")).verdict
    assert not mark("one", case, None).named


def test_each_push_has_to_be_named_at_its_moment() -> None:
    """In its episode, within a fifth of a second."""
    case = Keyed("a.csv", "a.xml", [PUSH], ["partly_explained"])
    one = cause("push", "elbow", seconds=[4.3, 4.5], extra={"episode": 0})
    two = cause("push", "elbow", seconds=[2.7, 2.9], extra={"episode": 1})
    late = cause("push", "elbow", seconds=[3.2, 3.4], extra={"episode": 1})
    assert mark("one", case, report("partly_explained", one, two)).named
    assert not mark("one", case, report("partly_explained", one)).named
    assert not mark("one", case, report("partly_explained", one, late)).named


def test_a_folder_without_the_logs_is_refused(tmp_path: Path) -> None:
    """With what is missing and how to give it."""
    exam = KeyedExam(str(tmp_path), {"one": ONE}, longest=60.0, block=1)
    with pytest.raises(Sim2RealError, match=r"has no a/a\.csv, which one needs.*SIM2REAL_DATA"):
        exam.draw(0)


def test_a_case_with_another_argument_is_refused() -> None:
    """With its name and what there is."""
    with pytest.raises(Sim2RealError, match=r"cases\.one: .*'effects'.*a case has log, model"):
        KeyedExam("data", {"one": ONE | {"effects": []}}, longest=60.0, block=1)


@pytest.mark.skipif(DATA is None, reason="SIM2REAL_DATA names no folder of real logs")
def test_the_experiment_makes_its_cases(tmp_path: Path) -> None:
    """Each has its log, with the model of the case, and what is excluded."""
    _, arguments = instantiate(compose(["+experiment=real_robots"]), tmp_path)
    exam = arguments["exam"]
    drawn = {one.name: one for one in exam.draw(0)}
    assert len(drawn) == 6
    logs = tmp_path / "logs"
    assert exam.make(drawn["pendulum_friction_excluded"], logs, tmp_path / "key")
    assert read_log(logs / "a.csv").meta["model"] == "model.xml"
    assert len(json.loads((logs / "task.json").read_text())["exclude"]) == 5
