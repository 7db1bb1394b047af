"""Cases of an exam: a balanced draw from one seed, and folders that keep the secret."""

import json
from collections import Counter
from pathlib import Path

import pytest

from hardware.log import read_logs
from sim2real.exam import cases, sizes
from sim2real.exam import logs as logs_module
from sim2real.exam.cases import KEY, Exam, Outline
from sim2real.exam.hiding import EFFECTS, place_of
from sim2real.runs.errors import Sim2RealError

FULL = Exam(["bench1", "arm6"], one=2, two=12, none=3, excluded=4, longest=60.0, block=4)


def test_every_robot_gets_every_effect_equally_often() -> None:
    """One hidden effect: each effect and robot twice; two: each effect about equally often."""
    drawn = FULL.draw(3)
    single = Counter((one.robot, *one.effects) for one in drawn if one.kind == "one")
    assert set(single.values()) == {2}
    assert len(single) == 2 * len(EFFECTS)
    pairs = Counter(e for one in drawn if one.kind == "two" for e in one.effects)
    assert max(pairs.values()) - min(pairs.get(e, 0) for e in EFFECTS) <= 3
    kinds = Counter(one.kind for one in drawn)
    assert (kinds["two"], kinds["none"], kinds["excluded"]) == (24, 6, 8)


def test_every_part_of_an_exam_has_kinds_and_robots_in_their_proportion() -> None:
    """Wherever it is stopped: of each kind and robot what its share is, give or take a case."""
    drawn = FULL.draw(3)
    whole = Counter((one.kind, one.robot) for one in drawn)
    for stop in (12, 40, 80):
        part = Counter((one.kind, one.robot) for one in drawn[:stop])
        assert all(abs(part[g] - n * stop / len(drawn)) < 1.6 for g, n in whole.items())


def test_the_same_seed_draws_the_same_cases() -> None:
    """Another seed draws others."""
    assert FULL.draw(3) == FULL.draw(3)
    assert [one.seed for one in FULL.draw(3)] != [one.seed for one in FULL.draw(4)]


def test_a_sample_holds_every_kind() -> None:
    """Even where its share of the kind would be less than a case."""
    drawn = Exam(
        ["bench1"], one=3, two=1, none=1, excluded=1, longest=60.0, block=4, sample=8
    ).draw(0)
    assert {one.kind for one in drawn} == {"one", "two", "none", "excluded"}
    assert len(drawn) == 8


@pytest.mark.parametrize(
    "wrong",
    [{"robots": []}, {"one": -1}, {"one": 0}, {"sample": 0}, {"longest": 0}, {"block": 0}],
    ids=str,
)
def test_an_exam_without_cases_is_refused(wrong: dict) -> None:
    """With the value and what to do."""
    given = {"robots": ["bench1"], "one": 1, "two": 0, "none": 0, "excluded": 0, "longest": 60.0}
    given |= {"block": 4} | wrong
    with pytest.raises(Sim2RealError, match=r"no case|must be at least 1|above 0 s"):
        Exam(**given)


@pytest.mark.slow
def test_a_case_keeps_its_secret(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a diagnosis is given names no effect; the key has a gap of the wanted size."""
    monkeypatch.setattr(logs_module, "SECONDS", 4.0)
    monkeypatch.setattr(logs_module, "AGAIN", 2.0)
    monkeypatch.setattr(sizes, "TRIALS", 6)
    exam = Exam(["bench1"], one=1, two=0, none=0, excluded=0, longest=60.0, block=4)
    logs, key = tmp_path / "logs", tmp_path / "keys"
    assert exam.make(Outline("case_000", "one", "bench1", ("dead_zone",), 5), logs, key)
    told = "".join(file.read_text() for file in logs.iterdir())
    assert "dead_zone" not in told
    case = json.loads((key / KEY).read_text())
    assert case["truths"][0]["effect"] == "dead_zone"
    assert 2.7 < case["gap"] / case["floor"] < 60
    assert case["residue"] < case["gap"] / 2
    assert sorted(p.name for p in logs.glob("*.csv")) == ["a.csv", "a_again.csv", "b.csv"]
    models = [log.model for log in [*read_logs(logs), *read_logs(key)]]
    assert len(models) == 4
    assert all(model is not None and model.is_file() for model in models)


def test_what_a_robot_cannot_show_is_drawn_again(tmp_path: Path, monkeypatch) -> None:
    """Pairs and effects to remove, the same ones for the same seed; single effects are not."""
    asked: list[tuple[str, ...]] = []
    monkeypatch.setattr(cases, "exam_robot", lambda name, logs: None)
    monkeypatch.setattr(cases, "hide", lambda robot, effects, seed: asked.append(effects))

    def tried(kind: str, *effects: str) -> list[tuple[str, ...]]:
        asked.clear()
        assert not FULL.make(Outline("case_000", kind, "arm6", effects, 5), tmp_path, tmp_path)
        return list(asked)

    pairs = tried("two", "backlash", "payload")
    assert pairs[0] == ("backlash", "payload") and len(set(pairs)) > 5
    assert all(len(set(pair)) == 2 for pair in pairs)
    assert not any(set(pair) <= family for pair in pairs for family in cases.ALIKE)
    assert tried("two", "backlash", "payload") == pairs
    removed = tried("excluded", "cogging")
    assert removed[0] == ("cogging",) and len(set(removed)) > 5
    assert all(place_of(effect) == "joint" for (effect,) in removed)
    assert tried("one", "cogging") == [("cogging",)]
