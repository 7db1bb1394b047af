"""The comparison on Hopper shares its runs, resumes, and computes the share that it promises."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import hopper_gap, study
from benchmarks.hopper_gap import Plan, main, report, run
from benchmarks.transfer import STUDY
from envs.effects import make, write_effects
from sim2real.evaluation.transfer import TransferScores, write
from sim2real.runs.statistics import Interval

LEVELS = {"source": 800.0, "corrected": 1500.0, "target": 1600.0}


class Shell:
    """Stands for the command line: remembers the jobs and leaves the files that they would."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.jobs: list[dict[str, str]] = []
        monkeypatch.setattr(study, "sim2real", self.run)
        monkeypatch.setattr(study, "trained", lambda folder: 0)
        monkeypatch.setattr(hopper_gap, "DRAWS", 200)

    def run(self, *arguments: str) -> bool:
        """Do a job."""
        given = dict(a.split("=", 1) for a in arguments)
        self.jobs.append(given)
        folder = Path(given["hydra.run.dir"])
        folder.mkdir(parents=True, exist_ok=True)
        if given["+experiment"] == "hopper_gap":
            mass = make("link_mass", where="torso")
            write_effects(folder / "effects.yaml", [(mass, (1.0,))])
            cause = {"effect": "link_mass", "value_ci": [0.96, 1.04], "unit": "kg"}
            (folder / "report.json").write_text(json.dumps({"causes": [cause]}))
            return True
        level = LEVELS[folder.parent.name] + 10 * float(given["seed"])
        one = TransferScores(
            f"seed {given['seed']}",
            "HopperPolito",
            None,
            int(given["frames"]) + 7,
            {"target": {"domain": "target"}},
            {"target": np.array([level - 5, level + 5])},
            {"target": np.array([500, 500])},
            {"target": 0},
        )
        write([one], 0, folder)
        return True


def plan(folder: Path, seeds: tuple[int, ...] = (0, 1, 2)) -> Plan:
    """Return a plan in a folder of its own."""
    return Plan(seeds, folder / "transfer", folder / "gap", folder / "results")


def test_what_is_closed_of_the_gap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """From 800 to 1500 of 1600: seven eighths, by runs that differ by less than that."""
    Shell(monkeypatch)
    assert run(plan(tmp_path)) == 0
    table = report(plan(tmp_path))
    assert table is not None
    closed = {row[0]: row[3] for row in table.rows}["the corrected source"]
    assert isinstance(closed, Interval)
    assert closed.value == pytest.approx(0.875)
    assert 0.8 < closed.low < 0.875 < closed.high < 0.95
    page = (tmp_path / "results" / "hopper_gap.md").read_text()
    assert "link_mass.torso +1 (90 % interval link_mass 0.96 to 1.04 kg)" in page
    assert "PARTIAL" not in page
    assert (tmp_path / "results" / "hopper_gap.png").is_file()


def test_the_runs_of_the_transfer_study_are_shared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those in the source and on the target lie where the study looks for them; others apart."""
    shell = Shell(monkeypatch)
    run(plan(tmp_path, (0,)))
    trained = [job for job in shell.jobs if job["+experiment"] != "hopper_gap"]
    folders = {Path(job["hydra.run.dir"]).relative_to(tmp_path).as_posix() for job in trained}
    assert folders == {"transfer/source/seed0", "transfer/target/seed0", "gap/corrected/seed0"}
    (own,) = [job for job in trained if "effects" in job]
    assert own["+experiment"] == "ppo_source"
    assert own["effects"] == str(tmp_path / "gap" / "diagnosis" / "effects.yaml")
    folders = (tmp_path / "transfer", tmp_path / "results")
    theirs = study.Plan(STUDY.rounds, ("source", "target"), (0,), *folders)
    done = len(shell.jobs)
    for name in theirs.rows:
        assert study.train(theirs, STUDY.rows[name], 0) is None
    assert len(shell.jobs) == done


def test_what_is_done_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second call neither diagnoses nor trains, and a part of the seeds is called a part."""
    shell = Shell(monkeypatch)
    run(plan(tmp_path))
    done = len(shell.jobs)
    assert run(plan(tmp_path)) == 0
    assert len(shell.jobs) == done
    report(plan(tmp_path, (0, 1, 2, 3)))
    assert "PARTIAL: 3 of 12 runs" in (tmp_path / "results" / "hopper_gap.md").read_text()


def test_no_table_of_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without two runs of each there is no interval, and the command says so."""
    places = ["--runs", str(tmp_path), "--out", str(tmp_path), "--results", str(tmp_path / "r")]
    assert main(["--report", *places]) == 1
    assert "two complete runs" in capsys.readouterr().err
