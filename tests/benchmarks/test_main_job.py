"""The table of the main job: each seed, their median, and that nothing is run twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import main_job
from benchmarks.main_job import main, report, table
from sim2real.evaluation.scores import GridScores
from tests.benchmarks.test_hopper_grid import GRID, PARAMETERS


def scores(level: float) -> GridScores:
    """Return a run that gets `level` before, and 60, 100 or 140 more after adaptation."""
    before = np.full((1, GRID.size, 3), level)
    after, spread = before + np.array([60.0, 100.0, 140.0]), np.ones_like(before)
    counts = (7_000_000,), (100,)
    return GridScores(
        GRID, PARAMETERS, {}, ("seed 0",), *counts, 3, 3, before, after, spread, spread
    )


def test_the_median_is_over_seeds_and_a_seed_s_interval_over_its_adaptations() -> None:
    """Of 900, 1000 and 1300 the median is 1000; a gain of 100 is that of every seed."""
    made = table({seed: scores(level) for seed, level in enumerate((900.0, 1300.0, 1000.0))})
    cells: list[Any] = made.rows
    *_, last = cells
    assert last[0] == "median" and last[2].value == 1000 and last[3].value == 1100
    assert (last[2].low, last[2].high) == (900, 1300) and last[4] == pytest.approx((100, 100, 100))
    first = cells[0]
    assert first[4].value == pytest.approx(100) and 60 < first[4].low < 100 < first[4].high < 140
    assert len(table({3: scores(1.0)}).rows) == 1


def test_each_seed_runs_once_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is evaluated is left alone, what has a checkpoint is resumed, a failure is told."""
    jobs: list[tuple[str, ...]] = []

    def run(*arguments: str) -> bool:
        jobs.append(arguments)
        folder = Path(next(a for a in arguments if a.startswith("hydra.run.dir="))[14:])
        if "seed=2" in arguments:
            return False
        scores(1000.0).write(folder)
        return True

    monkeypatch.setattr(main_job, "sim2real", run)
    monkeypatch.setattr(main_job, "trained", lambda folder: 5 * (folder.name == "seed1"))
    out, results = tmp_path / "runs", tmp_path / "results"
    given = ["--out", str(out), "--results", str(results)]
    assert main([*given, "--seeds", "0", "1", "2"]) == 1
    assert [job[1] for job in jobs] == ["seed=0", "seed=1", "seed=2"]
    assert [any(a.startswith("resume=") for a in job) for job in jobs] == [False, True, False]
    assert main([*given, "--seeds", "0", "1"]) == 0 and len(jobs) == 3
    text = (results / "main_job.md").read_text()
    assert "| 0 | 7.0 M |" in text and "| median |" in text and "benchmarks.main_job" in text
    assert not report(tmp_path / "nothing", results)
