"""The long Hopper comparison does each run once, goes on where it stopped, and says what it has."""

import csv
from pathlib import Path

import numpy as np
import pytest

from benchmarks import hopper_grid
from benchmarks.hopper_grid import BOX, METHODS, Plan, collect, run
from envs.params import Parameter
from sim2real.evaluation.grid import Grid
from sim2real.evaluation.scores import GridScores

GRID = Grid(
    [
        {"parameter": "link_mass.torso", "values": [0.5, 5.5, 10.5]},
        {"parameter": "ground_friction", "values": [1.0, 2.0]},
    ]
)
PARAMETERS = (
    Parameter("link_mass.torso", "link_mass", "torso", unit="kg", how="set"),
    Parameter("ground_friction", "ground_friction", how="set"),
)
LEVELS = {"es_fixed": 500.0, "es_dr": 1000.0, "esmaml": 2000.0}


class Shell:
    """Stands for the command line: remembers the jobs and leaves the files that they would."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.jobs: list[tuple[str, ...]] = []
        self.steps: dict[Path, int] = {}
        monkeypatch.setattr(hopper_grid, "DRAWS", 200)
        monkeypatch.setattr(hopper_grid, "sim2real", self.run)
        monkeypatch.setattr(hopper_grid, "picture", lambda scores, path: None)
        monkeypatch.setattr(hopper_grid, "trained", lambda folder: self.steps.get(folder, 0))

    def run(self, *arguments: str) -> bool:
        """Do a job."""
        self.jobs.append(arguments)
        given = dict(a.split("=", 1) for a in arguments)
        folder = Path(given["hydra.run.dir"])
        if "run" in given:
            self.evaluate(Path(given["checkpoint"]), given["+experiment"], folder)
        else:
            self.steps[folder] = int(given["frames"]) + 7
        return True

    def evaluate(self, source: Path, experiment: str, folder: Path) -> None:
        """Write scores by the level of the experiment that was trained, 10 apart for each seed."""
        seed = int(source.name.removeprefix("seed"))
        adapts = 3 if experiment == "esmaml" else 0
        before = np.full((1, 6, 2), LEVELS[source.parent.name] + 10 * seed)
        after = before + 100 * (adapts > 0)
        counts = ((self.steps[source],), (100,), 25, adapts)
        scores = GridScores(
            GRID, PARAMETERS, BOX, (f"seed {seed}",), *counts, before, after, before * 0, after * 0
        )
        scores.write(folder)


def plan(tmp_path: Path, seeds: tuple[int, ...] = (0, 1)) -> Plan:
    """Return a plan for a thousand steps."""
    return Plan(1000, seeds, tmp_path / "runs", tmp_path / "results", ("eval.episodes=25",))


def test_each_run_is_trained_once_and_evaluated_by_its_methods(tmp_path: Path, monkeypatch) -> None:
    """Three trainings and four evaluations a seed: es_dr is evaluated with and without adapting."""
    shell = Shell(monkeypatch)
    run(plan(tmp_path))
    trainings = [job for job in shell.jobs if "run=evaluate" not in job]
    assert [job[0] for job in trainings[:3]] == [
        f"+experiment={name}" for name in ("es_fixed", "es_dr", "esmaml")
    ]
    assert len(trainings) == 6
    assert len(shell.jobs) == 6 + 8
    assert not any("eval.episodes=25" in job for job in trainings)
    assert all("eval.episodes=25" in job for job in shell.jobs if job not in trainings)


def test_what_is_complete_is_not_repeated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second call does nothing; a larger budget resumes the training and evaluates again."""
    shell = Shell(monkeypatch)
    run(plan(tmp_path, (0,)))
    shell.jobs.clear()
    run(plan(tmp_path, (0,)))
    assert shell.jobs == []
    larger = Plan(5000, (0,), tmp_path / "runs", tmp_path / "results")
    run(larger)
    folder = larger.folder(METHODS[0], 0)
    assert f"resume={folder}" in shell.jobs[0]
    assert len(shell.jobs) == 3 + 4


def test_partial_results_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After one seed of two the page counts the runs; when all are there it does not."""
    Shell(monkeypatch)
    run(plan(tmp_path, (0,)))
    page = tmp_path / "results" / "hopper_grid.md"
    assert "Partial" not in page.read_text(encoding="utf-8")
    collect(plan(tmp_path))
    assert "**Partial results.** Runs so far, of 2 each: es_fixed 1" in page.read_text("utf-8")
    run(plan(tmp_path))
    assert "Partial" not in page.read_text(encoding="utf-8")


def test_the_page_holds_the_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Means over seeds, the gain by adaptation, the study's row and the picture are there."""
    draw = hopper_grid.picture
    Shell(monkeypatch)
    run(plan(tmp_path))
    draw(hopper_grid.gather(plan(tmp_path)), tmp_path / "results" / "hopper_grid.png")
    page = (tmp_path / "results" / "hopper_grid.md").read_text(encoding="utf-8")
    assert "| es_fixed | 2 | 1007 | 505 [500, 510]" in page
    assert "| esmaml, adapted | 2 | 1007 | 2105 [2100, 2110]" in page
    assert (
        "| esmaml: after against before adaptation | 100 [100, 100] | 1.00 [1.00, 1.00] |" in page
    )
    assert "| esmaml against es_dr, adapted | 1000 [990, 1010] | 1.00 [1.00, 1.00] |" in page
    assert "| the study: ES-Sim2Real, adapted | 5 | – | 1890 | 3160 | 1430 | 0.49 |" in page
    assert "friction_mode: contact" in page
    assert (tmp_path / "results" / "hopper_grid.png").stat().st_size > 10_000


def test_the_cells_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One row for each method, run and cell, with the steps that the run was trained for."""
    Shell(monkeypatch)
    run(plan(tmp_path))
    with (tmp_path / "results" / "hopper_grid.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4 * 2 * 6
    last = rows[-1]
    assert (last["method"], last["run"], last["training_steps"]) == ("esmaml", "seed 1", "1007")
    assert (last["link_mass.torso"], last["ground_friction"]) == ("10.5", "2.0")
    assert (float(last["before"]), float(last["after"])) == (2010.0, 2110.0)


def test_a_job_that_fails_ends_the_benchmark(tmp_path: Path, capfd) -> None:
    """The message says what failed, its status, and that starting again goes on."""
    with pytest.raises(SystemExit) as stop:
        hopper_grid.do("+experiment=no_such_experiment", f"hydra.run.dir={tmp_path}")
    assert stop.value.code == 1
    assert "ended with status 2; start this benchmark again to go on" in capfd.readouterr().err
