"""The comparison on a servo robot resumes, and computes the share that it promises."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks import robot_gap, study
from benchmarks.robot_gap import Plan, main, report, run
from sim2real.runs.statistics import Interval

LEVELS = {"nominal": 0.5, "corrected": 2.0, "truth": 2.5}


def job(*arguments: str) -> bool:
    """Stand for the command line: leave the file that a run would."""
    given = dict(a.split("=", 1) for a in arguments)
    assert given["hydra.run.dir"] == given["resume"]
    more = 0.1 * float(given["seed"])
    policies = {
        name: {"simulator": [2.5, 2.7], "robot": [level + more, level + more]}
        for name, level in LEVELS.items()
    }
    content = {"seed": int(given["seed"]), "found": "command_delay 0.0192", "policies": policies}
    (Path(given["resume"]) / "gap.json").write_text(json.dumps(content))
    return True


def test_what_is_closed_of_the_gap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From 0.5 to 2.0 of 2.5 are three quarters; a second call runs nothing."""
    monkeypatch.setattr(study, "sim2real", job)
    monkeypatch.setattr(robot_gap, "DRAWS", 200)
    plan = Plan((0, 1, 2), tmp_path / "runs", tmp_path / "results")
    assert run(plan) == 0
    monkeypatch.setattr(study, "sim2real", lambda *arguments: pytest.fail("nothing is left to do"))
    assert run(plan) == 0
    table = report(plan)
    assert table is not None
    closed = {row[0]: row[4] for row in table.rows}["with what was found"]
    assert isinstance(closed, Interval)
    assert closed.value == pytest.approx(0.75)
    assert closed.low < 0.75 < closed.high
    page = (tmp_path / "results" / "robot_gap.md").read_text()
    assert "seed 1: command_delay 0.0192" in page and "PARTIAL" not in page
    assert (tmp_path / "results" / "robot_gap.png").is_file()
    report(Plan((0, 1, 2, 3), tmp_path / "runs", tmp_path / "results"))
    assert "PARTIAL: 1 of 4 runs" in (tmp_path / "results" / "robot_gap.md").read_text()


def test_no_table_of_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without two runs the command says so."""
    assert main(["--report", "--out", str(tmp_path), "--results", str(tmp_path / "r")]) == 1
    assert "two complete runs" in capsys.readouterr().err
