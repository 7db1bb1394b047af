"""A sweep's jobs in other processes, by Hydra's launchers: the tables of this one, to the byte.

A population over Ray is in `learning/population/test_cluster.py`.
"""

import csv
import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from envs.tasks.servo.base import ASSETS

ROOT = Path(__file__).resolve().parents[2]
JOBS = {
    "study": [
        *("+experiment=nav2d", "iterations=2", "algorithm.pairs=2", "adapt.queries=2"),
        *("algorithm.num_rows=4", "algorithm.refill=1", "env.max_steps=5"),
    ],
    "identification": [
        *("run=identify", f"log={ASSETS / 'demo' / 'arm2.csv'}", "candidates=[coulomb_friction]"),
        *("identify.search.generations=2",),
    ],
    "exam": [
        *("run=blindcheck", "exam.robots=[bench1]", "exam.one=1", "exam.two=0", "exam.none=0"),
        *("exam.excluded=0", "exam.sample=1", "exam.block=1"),
    ],
}
LAUNCHERS = {
    "joblib": ("hydra_joblib_launcher", ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"]),
    "submitit": ("hydra_submitit_launcher", ["hydra/launcher=submitit_local"]),
}
OTHERWISE = {"timing.csv", "config.yaml", "multirun.yaml"}  # times, and where the run was


def swept(job: str, folder: Path, *words: str) -> dict[str, list[list[str]]]:
    """Run two jobs of a sweep in a folder; return their tables by their names."""
    folder.mkdir()
    command = [sys.executable, "-m", "sim2real", "-m", *JOBS[job], "seed=0,1", *words]
    paths = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = os.environ | {"PYTHONPATH": paths}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (sweep,) = (path.parent for path in folder.rglob("multirun.yaml"))
    files = [p for p in sweep.glob("[01]/**/*") if p.suffix in (".csv", ".yaml", ".md")]
    kept = [p for p in files if p.name not in OTHERWISE and ".hydra" not in p.parts]
    return {str(path.relative_to(sweep)): without_seconds(path) for path in kept}


def without_seconds(path: Path) -> list[list[str]]:
    """Return a file's lines, cell by cell, without how long an exam's diagnoses took."""
    with path.open(newline="") as file:
        lines = [line for line in csv.reader(file) if not any("seconds a" in cell for cell in line)]
    times = [i for i, name in enumerate(lines[0] if lines else []) if name == "seconds"]
    return [[cell for i, cell in enumerate(line) if i not in times] for line in lines]


@pytest.fixture(scope="module", params=JOBS)
def one(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory):
    """A kind of job, and the tables of two of them that one process computes."""
    return request.param, swept(request.param, tmp_path_factory.mktemp("one") / "run")


@pytest.mark.slow
@pytest.mark.timeout(14400)
@pytest.mark.parametrize("launcher", LAUNCHERS)
def test_a_launchers_workers_give_the_same_tables(one, launcher: str, tmp_path: Path) -> None:
    """Two seeds of a study, of an identification, of an exam: every table, to the byte."""
    package, words = LAUNCHERS[launcher]
    try:
        importlib.import_module(f"hydra_plugins.{package}")
    except ModuleNotFoundError:
        pytest.skip(f"hydra's {launcher} launcher is not installed")
    job, tables = one
    assert any(name.startswith("0/") for name in tables)
    assert any(name.startswith("1/") for name in tables)
    assert swept(job, tmp_path / "run", *words) == tables
