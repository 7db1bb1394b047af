"""The benchmark of policies that know their robot: its claims, and that nothing is run twice."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import conditioned
from benchmarks.conditioned import main, table, verdicts
from sim2real.evaluation.scores import GridScores
from tests.benchmarks.test_hopper_grid import GRID, PARAMETERS


def scores(level: float) -> GridScores:
    """Return a run that gets `level` after adapting and 100 less before."""
    after = np.full((1, GRID.size, 1), level)
    counts = (3_000_000,), (100,)
    box = {GRID.names[0]: (-1e9, 1e9)}
    spread = np.ones_like(after)
    return GridScores(
        GRID, PARAMETERS, box, ("seed 0",), *counts, 3, 3, after - 100, after, spread, spread
    )


def found(own: tuple[float, ...], oracle: tuple[float, ...], rival: tuple[float, ...]) -> dict:
    """Return scores of three rows, a level a seed."""
    levels = {"identify": own, "oracle": oracle, "esmaml": rival}
    return {name: {s: scores(x) for s, x in enumerate(row)} for name, row in levels.items()}


def test_claims_are_decided_by_intervals_of_paired_seeds() -> None:
    """A claim holds where its whole interval does; one seed has none, a rival may be missing."""
    good = verdicts(found((950.0, 990.0, 940.0), (1000.0,) * 3, (900.0, 930.0, 890.0)))
    assert "oracle: holds; 0.96 [0.94, 0.99] on 3 seeds" in good[0]
    assert "above ES-MAML after hill climbing: holds" in good[1]
    assert good[2].endswith("not run.")
    poor = verdicts(found((950.0, 850.0), (1000.0, 1000.0), (900.0, 900.0)))
    assert "undecided; 0.9 [0.85, 0.95]" in poor[0] and "undecided" in poor[1]
    worse = verdicts(found((850.0, 800.0), (1000.0, 1000.0), (900.0, 900.0)))
    assert "contradicted; 0.825 [0.8, 0.85]" in worse[0] and "contradicted" in worse[1]
    more = found((950.0, 990.0), (1000.0, 1000.0), (900.0, 900.0))
    more["esmaml"] = {s: replace(one, frames=(7_000_000,)) for s, one in more["esmaml"].items()}
    assert "not decided, 3e+06 steps of training against 7e+06" in verdicts(more)[1]
    assert "undecided" in verdicts(found((950.0,), (1000.0,), (900.0,)))[0]


def test_the_table_tells_returns_before_adapting_too() -> None:
    """What is told the middle is what identification begins with."""
    made = table(found((950.0, 990.0), (1000.0, 1010.0), (900.0, 930.0)))
    rows = {str(row[0]): row for row in made.rows}
    assert rows["told the truth"][3].value == 1005  # type: ignore[union-attr]
    assert rows["told the middle"][3].value == 870  # type: ignore[union-attr]
    assert rows["ES-MAML, before adapting"][3].value == 815  # type: ignore[union-attr]
    assert rows["told the middle"][1:3] == (2, 3_000_000.0)


def test_what_is_there_is_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A teacher is trained before its student, once for all rows, for the steps that were asked."""
    jobs: list[tuple[str, ...]] = []

    def run(*arguments: str) -> bool:
        jobs.append(arguments)
        folder = Path(next(a for a in arguments if a.startswith("hydra.run.dir="))[14:])
        (folder / "plots").mkdir(parents=True)
        if "run=evaluate" in arguments:
            scores(1000.0).write(folder)
        return True

    monkeypatch.setattr(conditioned, "sim2real", run)
    monkeypatch.setattr(conditioned, "trained", lambda folder: 500 * (folder / "plots").is_dir())
    given = ["--out", str(tmp_path / "runs"), "--results", str(tmp_path / "results")]
    given += ["--seeds", "0", "--frames", "500", "--cells", "2", "3"]
    assert main([*given, "--rows", "student", "identify"]) == 0
    first, student, *others = jobs
    assert first[0] == "+experiment=conditioned" and "algorithm=distill" in student
    assert [job[0] for job in others] == ["run=evaluate", "run=evaluate"]
    teacher = tmp_path / "runs" / "conditioned" / "seed0"
    assert "frames=500" in first and f"algorithm.teacher.checkpoint={teacher}" in student
    assert "adapt=identify" in jobs[3] and "eval.grid.axes.0.count=2" in jobs[3]
    assert main([*given, "--rows", "student", "identify"]) == 0 and len(jobs) == 4
    text = (tmp_path / "results" / "conditioned.md").read_text()
    assert "told what 3 episodes' logs say" in text and "benchmarks.conditioned" in text
    assert (tmp_path / "results" / "conditioned.png").stat().st_size > 5000
