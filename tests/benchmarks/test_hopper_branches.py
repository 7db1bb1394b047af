"""The paired branches of one trunk: what is compared, what it says, and that nothing runs twice."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import hopper_branches
from benchmarks.hopper_branches import TESTS, Trial, contrast, interval, main
from sim2real.config.compose import compose
from sim2real.evaluation.scores import GridScores
from sim2real.runs.statistics import Interval
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


def found(own: tuple[float, ...], other: tuple[float, ...]) -> dict:
    """Return scores of the primary contrast's branches, a level a seed."""
    pair = {"esmaml_10": own, "es_dr": other}
    return {("10", name): {s: scores(x) for s, x in enumerate(row)} for name, row in pair.items()}


@pytest.mark.parametrize("trial", TESTS.values(), ids=TESTS)
def test_a_trial_composes(trial: Trial) -> None:
    """Each evaluation sets keys that are there; `seed` writes the friction of the foot alone."""
    tree = compose(["+experiment=es_dr", "adapt=hillclimb", *trial.words])
    assert tree["adapt"]["queries"] == trial.episodes - 1
    friction = tree["params"]["draws"][1]
    assert friction["effect"] == "ground_friction"
    assert ("friction_mode" in friction) == ("friction of the foot" in trial.text)


def test_seeds_are_paired_by_their_trunk() -> None:
    """What trunks have in common drops out of the difference."""
    apart = contrast(
        found((500.0, 1100.0, 1900.0), (400.0, 1000.0, 1790.0)), "10", "esmaml_10", "es_dr"
    )
    assert apart is not None and apart[0] == 3 and apart[2] == "holds"
    assert isinstance(apart[1], Interval) and apart[1].low > 85
    less = contrast(
        found((400.0, 1000.0, 1790.0), (500.0, 1100.0, 1900.0)), "10", "esmaml_10", "es_dr"
    )
    assert less is not None and less[2] == "contradicted"


def test_no_difference_is_claimed_within_a_margin_only() -> None:
    """A wide interval about zero is undecided; a narrow one within a tenth says alike."""
    close = found((1010.0, 990.0, 1005.0, 995.0), (1000.0,) * 4)
    answer = contrast(close, "10", "esmaml_10", "es_dr")
    assert answer is not None and answer[2] == "alike within 100"
    wide = contrast(found((1300.0, 700.0, 1200.0), (1000.0,) * 3), "10", "esmaml_10", "es_dr")
    assert wide is not None and wide[2] == "undecided"
    assert contrast(close, "3", "esmaml_10", "es_dr") is None


def test_intervals_are_students() -> None:
    """Of three numbers the interval is the mean and 4.303 standard errors."""
    made = interval(np.array([1.0, 2.0, 3.0]))
    assert isinstance(made, Interval)
    assert made.high - made.value == pytest.approx(4.302653 / np.sqrt(3), rel=1e-5)


def test_branches_start_from_the_trunk_and_nothing_is_run_twice(tmp_path, monkeypatch) -> None:
    """A trunk is trained once; a branch goes on from it for as many steps as were asked."""
    jobs: list[tuple[str, ...]] = []
    steps: dict[Path, int] = {}

    def run(*arguments: str) -> bool:
        jobs.append(arguments)
        folder = Path(next(a for a in arguments if a.startswith("hydra.run.dir="))[14:])
        folder.mkdir(parents=True, exist_ok=True)
        if "run=evaluate" in arguments:
            scores(1000.0).write(folder)
        else:
            frames = next(a for a in arguments if a.startswith("frames="))
            steps[folder] = int(frames[7:]) + 5  # a run ends with a whole iteration
        return True

    monkeypatch.setattr(hopper_branches, "sim2real", run)
    monkeypatch.setattr(hopper_branches, "trained", lambda folder: steps.get(folder, 0))
    given = ["--out", str(tmp_path / "runs"), "--results", str(tmp_path / "results")]
    given += ["--seeds", "0", "--trunk", "100", "--branch", "50", "--tests", "10"]
    assert main(given) == 0
    trunk = tmp_path / "runs" / "seed0" / "trunk"
    trainings = [job for job in jobs if "run=evaluate" not in job]
    assert [job[0] for job in trainings] == [
        f"+experiment={e}" for e in ("es_dr", "es_dr", "esmaml", "esmaml")
    ]
    assert all(f"start={trunk}" in job and "frames=155" in job for job in trainings[1:])
    assert "adapt.queries=9" in trainings[3] and "adapt.queries=9" in jobs[-1]
    assert "Primary contrast" in (tmp_path / "results" / "hopper_branches.md").read_text()
    runs = (tmp_path / "results" / "hopper_branches_runs.csv").read_text().splitlines()
    assert len(runs) == 4 and runs[3] == "esmaml_10,10,0,3000000,900.0,1000.0"
    done = len(jobs)
    assert main(given) == 0 and len(jobs) == done
    steps[trunk.parent / "esmaml_3"] = 120  # it was stopped
    assert main(given) == 0
    assert f"resume={trunk.parent / 'esmaml_3'}" in jobs[-1] and not any(
        "start=" in w for w in jobs[-1]
    )
