"""The benchmark of `compare`: what it hides, and how an answer is scored."""

import argparse
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks import compare as bench
from hardware.config import load_robot
from sim2real.diagnosis.comparison.answer import Alike


def answer(*changes: tuple[str, str | None]) -> SimpleNamespace:
    """Return an answer that names these changes."""
    made = [
        SimpleNamespace(effect=e, where=w, alike=(Alike("backlash", "elbow"),)) for e, w in changes
    ]
    return SimpleNamespace(verdict="changed" if made else "unchanged", changes=made)


@pytest.mark.parametrize(
    ("kind", "joint", "said", "right"),
    [
        ("unchanged", None, answer(), True),
        ("unchanged", None, answer(("payload", "elbow")), False),
        ("friction", "elbow", answer(("coulomb_friction", "elbow")), True),
        ("friction", "elbow", answer(("coulomb_friction", "shoulder")), False),
        ("friction", "elbow", answer(("payload", "elbow"), ("coulomb_friction", "elbow")), False),
        ("zero", "elbow", answer(), False),
        ("supply", None, answer(("supply_voltage", None)), True),
    ],
)
def test_only_the_first_change_counts(kind: str, joint: str | None, said, right: bool) -> None:
    """Or an equivalent of it; a second one that is right does not."""
    pair: Any = SimpleNamespace(kind=kind, joint=joint)
    assert bench.is_named(said, pair) is right


def test_what_is_hidden_is_what_the_text_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """One motion twice; a bolted arm keeps its tilt; friction, strength and supply as written."""
    asked: list = []

    def drive(robot, entries, plan, seed):
        asked.append((entries, plan, seed))
        return bench.Log(COLUMNS)

    monkeypatch.setattr(bench, "drive", drive)
    robot = load_robot("arm2")
    monkeypatch.setattr(bench, "home_pose", lambda _: np.zeros(2))
    pair = bench.make("friction", robot, np.random.default_rng(0), 4.0, bolted=True)
    (first, plan, one), (second, again, other) = asked
    assert plan is again and one != other
    tilts = [
        next(e["value"] for e in own if e["effect"] == "gravity_tilt") for own in (first, second)
    ]
    assert tilts[0] == tilts[1]
    rubs = [
        {e["where"]: e["value"] for e in own if e["effect"] == "coulomb_friction"}
        for own in (first, second)
    ]
    ratio = {joint: rubs[1][joint] / rubs[0][joint] for joint in rubs[0]}
    others = [joint for joint in ratio if joint != pair.joint]
    assert ratio[pair.joint] / ratio[others[0]] == pytest.approx(1.15)
    warmer = float(pair.after.column("temperature.elbow")[0] - 25.0)
    strength = next(e["value"] for e in second if e["effect"] == "motor_strength")
    assert strength == pytest.approx(1 - 0.004 * warmer)


COLUMNS = {
    "episode": [0, 0],
    "time": [0.0, 0.02],
    "ctrl.elbow": [0.0, 0.0],
    "qpos.elbow": [0.0, 0.0],
    "temperature.elbow": [25.0, 25.0],
}


def test_the_table_counts_each_kind(tmp_path: Path) -> None:
    """Unchanged pairs first, bolted ones by themselves, with exact intervals."""
    rows = [
        bench.Row("1-0", "unchanged", "", 0, "unchanged", "", 1, 0, "1.0"),
        bench.Row("1-1", "zero", "elbow", 1, "changed", "x", 0, 1, "3.0"),
    ]
    given = argparse.Namespace(pairs=2, seed=1, seconds=120.0, kinds=["zero"], results=tmp_path)
    bench.keep(rows, given)
    text = (tmp_path / "compare.md").read_text()
    assert text.index("unchanged") < text.index("zero of the elbow, bolted")
    assert "1.00 [0.03, 1.00]" in text and "--pairs 2 --seed 1 --kinds zero --seconds 120" in text
    assert "all unchanged | 1 |" in text and "1 further changes" in text


def test_a_pair_that_is_there_is_not_made_again(tmp_path: Path, monkeypatch) -> None:
    """The second run adds what the first one lacks."""
    made: list[int] = []

    def judge(number: int, robot, seed: int, seconds: float, kinds: list[str]) -> bench.Row:
        made.append(number)
        return bench.Row(f"{seed}-{number}", "unchanged", "", 0, "unchanged", "", 1, 0, "1.0")

    monkeypatch.setattr(bench, "judge", judge)
    for pairs in ("2", "3"):
        bench.main(["--pairs", pairs, "--seed", "4", "--results", str(tmp_path)])
    assert made == [0, 1, 2]
