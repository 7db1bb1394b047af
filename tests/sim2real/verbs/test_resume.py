"""A run that is killed and resumed computes, bit for bit, what an uninterrupted one does."""

import multiprocessing
import runpy
import signal
import sys
import time
import zipfile
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import numpy as np
import pytest

from sim2real.runs.checkpoint import find, listing

NAV2D = ("+experiment=nav2d", "iterations=40", "checkpoint_every=3")
NAV2D += ("algorithm.pairs=8", "adapt.queries=4")
PPO = (
    "env=inverted_pendulum", "algorithm=ppo", "iterations=40", "checkpoint_every=3",
    "algorithm.num_rows=8", "algorithm.epochs=2",
)  # fmt: skip
SAC = (
    "env=inverted_pendulum", "algorithm=sac", "policy.actor.num_cells=[16]",
    "policy.qvalue.num_cells=[16]", "iterations=40", "checkpoint_every=3", "algorithm.steps=20",
    "algorithm.batch_size=16",
)  # fmt: skip
HOPPER = ("+experiment=esmaml", "frames=null", "iterations=20", "checkpoint_every=2")


MACHINE = multiprocessing.get_context("forkserver")  # imports once, then forks for each run
MACHINE.set_forkserver_preload(["sim2real.learning.training", "matplotlib.figure", "hydra"])


def start(experiment: tuple[str, ...], out: Path, resume: Path | None) -> ForkServerProcess:
    """Start the command line in a process of its own."""
    command = ["sim2real", *experiment, "eval=none", "video=none", f"hydra.run.dir={out}"]
    process = MACHINE.Process(
        target=runpy.run_module, args=("sim2real",), kwargs={"run_name": "__main__"}, daemon=True
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", command + ([f"resume={resume}"] if resume else []))
        process.start()
    return process


def finish(process: ForkServerProcess) -> None:
    """Wait for a run that nothing kills."""
    process.join(900)
    assert process.exitcode == 0


def kill_when(process: ForkServerProcess, out: Path, rows: int, delay: float) -> int | None:
    """Send SIGKILL a moment after metrics.csv has so many rows; return how the process ended."""
    while process.is_alive():
        metrics = out / "metrics.csv"
        if metrics.exists() and metrics.read_text().count("\n") > rows:
            time.sleep(delay)
            break
        time.sleep(0.002)
    process.kill()
    process.join()
    return process.exitcode


def state(run: Path) -> dict[str, bytes]:
    """Return all bytes of the algorithm's state in a run's newest checkpoint."""
    with zipfile.ZipFile(find(run)) as archive:
        names = [name for name in archive.namelist() if "-algorithm/" in name]
        return {name: archive.read(name) for name in names}


def check(experiment: tuple[str, ...], folder: Path, last: int, seconds: float) -> None:
    """Kill a run at three random points, resume it each time, and compare the end with a whole run.

    Args:
        experiment: the run.
        folder: for the runs' folders.
        last: its iterations.
        seconds: about how long an iteration takes.
    """
    whole = start(experiment, folder / "whole", None)
    rng = np.random.default_rng()
    points = np.sort(rng.integers(1, last - 2, 3)).tolist()
    delays = rng.uniform(0, 2 * seconds, 3).tolist()
    print("killed after rows", points, "and", delays)  # noqa: T201 - to repeat a failure
    resume, ends = None, []
    for number, (rows, delay) in enumerate(zip(points, delays, strict=True)):
        out = folder / str(number)
        ends.append(kill_when(start(experiment, out, resume), out, rows, delay))
        resume = out if listing(out / "checkpoints") else resume
    assert -signal.SIGKILL in ends
    finish(start(experiment, folder / "end", resume))
    finish(whole)
    assert state(folder / "end") == state(folder / "whole") and len(state(folder / "end")) == 2
    metrics = (folder / "end" / "metrics.csv").read_bytes()
    assert metrics == (folder / "whole" / "metrics.csv").read_bytes()
    assert metrics.count(b"\n") == last + 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("experiment", "last", "seconds"),
    [
        pytest.param(NAV2D, 40, 0.05, id="nav2d"),
        pytest.param(PPO, 40, 0.05, id="ppo"),  # episodes in progress are part of its state
        pytest.param(SAC, 40, 0.3, id="sac"),  # with all that it remembers
        pytest.param(HOPPER, 20, 1.0, id="hopper"),  # the main job, in two threads
    ],
)
def test_it_survives_three_kills(experiment: tuple[str, ...], last: int, seconds, tmp_path) -> None:
    """SIGKILL at three random points changes no bit of state or metrics."""
    check(experiment, tmp_path, last, seconds)
