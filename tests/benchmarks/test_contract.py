"""The benchmark of the policy's interface: what counts as named, and one walk of each robot."""

from typing import Any

import pytest

from benchmarks import contract
from sim2real.diagnosis.contract.answer import Answer, Fault, Finding

SIGN = ("observation", "sign", "gyro: x")
AGE = ("observation", "age", "gyro")


def answer(*named: tuple[str, str, str], among: tuple[Fault, ...] = ()) -> Answer:
    """Return an answer that names faults, each with the same rivals."""
    found = tuple(Finding(*one, "text", "fix", 1.0, 0.0, among=among) for one in named)
    return Answer("broken", found, (), {}, {})


def test_what_counts_as_named() -> None:
    """All of the key and nothing else; a rival of a named set counts."""
    assert contract.named(answer(SIGN, AGE), [AGE, SIGN])
    assert contract.named(answer(), [])
    assert not contract.named(answer(SIGN), [SIGN, AGE])
    assert not contract.named(answer(SIGN, AGE), [SIGN])
    rival = Fault("age", "gyro", "text", "fix")
    assert contract.named(answer(SIGN, among=(rival,)), [AGE])
    assert not contract.named(answer(SIGN), [AGE])


@pytest.mark.parametrize("number", range(len(contract.ROBOTS)))
def test_a_sound_walk_has_no_finding(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of each robot; the key is empty and so is the answer."""
    monkeypatch.setattr(contract, "SECONDS", 1.0)
    told = contract.case(3, number, faulty=False)
    assert told["robot"] == contract.ROBOTS[number]
    assert (told["key"], told["found"], told["named"]) == ([], [], True)


def test_the_table_counts_and_names_what_was_missed() -> None:
    """Each case stands in one row of its robot, and in one of all."""
    right = {"robot": "quad8", "key": [SIGN], "found": [SIGN], "named": True}
    wrong = {"robot": "arm6", "key": [SIGN, AGE], "found": [], "named": False}
    sound = {"robot": "arm6", "key": [], "found": [], "named": True}
    rows: dict[Any, Any] = {row[0]: row[1:] for row in contract.table([right, wrong, sound]).rows}
    assert set(rows) == {"one fault, quad8", "two faults, arm6", "all faulty", "sound"}
    assert rows["all faulty"][0] == 2
    assert rows["all faulty"][1].value == 0.5
    assert "found nothing" in contract.missed([right, wrong, sound])[0]
