"""The training loop on an algorithm of a few lines: files, signals, full disks, resuming."""

import csv
import errno
import logging
import os
import signal
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from envs.errors import RenderError
from envs.toys import FourCorners, Nav2D, NavGoals, ToyEnv
from sim2real.learning.algorithms.base import Algorithm, Components
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.checkpoint import listing, read_metadata
from sim2real.runs.errors import CheckpointError, DiskError, RunInterrupted, Sim2RealError
from sim2real.runs.loggers import Loggers
from sim2real.runs.metrics import MetricsFile
from sim2real.verbs import train as verb


class Walk(Algorithm):
    """Adds noise to a number; `events` are called at the start of an iteration, by its number."""

    def __init__(self, parts: Components, events: dict[int, Any] | None = None) -> None:
        self.parts, self.rng = parts, np.random.default_rng(parts.seed)
        self.value, self.frames, self.iteration = 0.0, 0, 0
        self.events = events or {}

    def iterate(self) -> dict[str, float]:
        """Walk on."""
        if self.iteration + 1 in self.events:
            self.events[self.iteration + 1]()
        self.value += float(self.rng.standard_normal())
        self.iteration += 1
        self.frames += 10
        return {"train/return": self.value, "train/frames": float(self.frames)}

    shape: ClassVar[dict[str, Any]] = {}  # type: ignore[misc]

    def trained(self) -> TrainedPolicy:
        """Walks have no policy."""
        raise NotImplementedError

    def state_dict(self) -> dict[str, Any]:
        """Return all of it."""
        rng = self.rng.bit_generator.state
        return {"rng": rng, "value": self.value, "counts": (self.frames, self.iteration)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go back."""
        self.rng.bit_generator.state = state["rng"]
        self.value = state["value"]
        self.frames, self.iteration = state["counts"]


def world(toy: Any = Nav2D) -> Components:
    """Return parts whose environment counts by its name only."""
    return Components(EnvironmentFactory(partial(ToyEnv, partial(toy)), NavGoals()), policy=None)  # type: ignore[arg-type]


def go(out: Path, events: dict[int, Any] | None = None, **changes: Any) -> Walk:
    """Train a walk for 10 iterations with a checkpoint every 4."""
    given: dict[str, Any] = {
        "parts": world(), "effects": None, "algorithm": lambda parts: Walk(parts, events),
        "eval": None, "logger": Loggers([]), "seed": 0, "iterations": 10, "frames": None,
        "checkpoint_every": 4, "keep_checkpoints": 5, "start": None, "resume": None, "video": None,
        "cluster": None, "out": out,
    }  # fmt: skip
    learner = verb.run(**(given | changes))
    assert isinstance(learner, Walk)
    return learner


def saved(out: Path) -> list[int]:
    """Return the iterations of a run's checkpoints."""
    return [read_metadata(path)["iteration"] for path in listing(out / "checkpoints")]


def same(first: Path, second: Path) -> bool:
    """Return whether two runs wrote the same metrics, byte for byte."""
    return (first / "metrics.csv").read_bytes() == (second / "metrics.csv").read_bytes()


def test_a_run_leaves_metrics_checkpoints_and_a_curve(tmp_path: Path) -> None:
    """A row an iteration, checkpoints at the interval and the end, the clock in a file apart."""
    learner = go(tmp_path)
    rows = list(csv.DictReader((tmp_path / "metrics.csv").open()))
    assert [int(row["train/iteration"]) for row in rows] == list(range(1, 11))
    assert float(rows[-1]["train/return"]) == learner.value
    assert not any(name.startswith("time/") for name in rows[0])
    assert float(next(csv.DictReader((tmp_path / "timing.csv").open()))["time/fps"]) > 0
    assert saved(tmp_path) == [4, 8, 10]
    assert (tmp_path / "plots" / "learning_curve.png").stat().st_size > 1000


def test_frames_end_a_run_too(tmp_path: Path) -> None:
    """No iteration starts once the environment steps are spent, whatever iterations allow."""
    assert go(tmp_path, frames=35).frames == 40


def test_resume_equals_never_stopped(tmp_path: Path) -> None:
    """A run of 6 that is resumed to 10 in a folder of its own has the metrics of a run of 10."""
    whole = go(tmp_path / "whole")
    go(tmp_path / "first", iterations=6)
    resumed = go(tmp_path / "second", resume=tmp_path / "first")
    assert resumed.value == whole.value and same(tmp_path / "whole", tmp_path / "second")
    assert saved(tmp_path / "second") == [4, 6, 10]


def test_a_run_goes_on_from_the_policy_of_another(tmp_path: Path) -> None:
    """In a folder of its own; what was spent before counts."""
    first = go(tmp_path / "first", iterations=6)
    tuned = go(tmp_path / "tuned", iterations=8, start=tmp_path / "first")
    rows = list(csv.DictReader((tmp_path / "tuned" / "metrics.csv").open()))
    assert (tuned.iteration, tuned.frames, len(rows)) == (8, 80, 2)
    assert abs(tuned.value - first.value) < 10 and tuned.value != first.value
    with pytest.raises(CheckpointError, match="has task Nav2D, but this run has task FourCorners"):
        go(tmp_path / "other", start=tmp_path / "first", parts=world(FourCorners))
    with pytest.raises(Sim2RealError, match=r"has 6 iterations and 60 steps.*iterations=12"):
        go(tmp_path / "spent", iterations=6, start=tmp_path / "first")
    assert not (tmp_path / "spent" / "checkpoints").exists()


def test_resume_in_place_forgets_what_came_after_the_checkpoint(tmp_path: Path) -> None:
    """Later rows are cut, a torn line too, and later checkpoints step aside."""
    go(tmp_path / "whole")
    go(tmp_path / "run")
    with (tmp_path / "run" / "metrics.csv").open("a") as file:
        file.write("11,0.5")
    earlier = listing(tmp_path / "run" / "checkpoints")[0]
    go(tmp_path / "run", resume=earlier)
    assert same(tmp_path / "whole", tmp_path / "run")
    assert saved(tmp_path / "run") == [4, 8, 10]
    aside = (tmp_path / "run" / "checkpoints").glob("*.superseded")
    assert len(list(aside)) == 2


def test_ctrl_c_finishes_the_iteration_and_says_how_to_resume(tmp_path: Path) -> None:
    """SIGINT and SIGTERM: a checkpoint of the iteration in progress, and one line with its path."""
    for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
        out = tmp_path / str(code)
        with pytest.raises(
            RunInterrupted, match=r"after iteration 6; .*resume=.*000006\.torchrl"
        ) as stop:
            go(out, events={6: lambda number=number: os.kill(os.getpid(), number)})
        assert stop.value.exit_code == code and saved(out) == [4, 6]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    go(tmp_path / "whole")
    go(tmp_path / "on", resume=tmp_path / "130")
    assert same(tmp_path / "whole", tmp_path / "on")


def test_a_second_ctrl_c_abandons_the_iteration(tmp_path: Path) -> None:
    """SIGINT and SIGTERM: a checkpoint of the iteration in progress, and a line with its path."""

    def twice() -> None:
        os.kill(os.getpid(), signal.SIGINT)
        os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(RunInterrupted, match=r"abandoned; .*000004\.torchrl"):
        go(tmp_path / "run", events={6: twice})
    go(tmp_path / "whole")
    go(tmp_path / "on", resume=tmp_path / "run")
    assert same(tmp_path / "whole", tmp_path / "on")


def test_ctrl_c_after_training_keeps_it(tmp_path: Path) -> None:
    """Interrupted while the evaluation runs, the line says that training is complete."""

    class Interrupted:
        def assess(self, *_: Any, **__: Any) -> None:
            raise KeyboardInterrupt

    with pytest.raises(RunInterrupted, match=r"training is complete.*000010\.torchrl"):
        go(tmp_path, eval=Interrupted())


def test_a_full_disk_stops_the_run_in_a_sentence(tmp_path: Path, monkeypatch) -> None:
    """What was written stays whole, and resuming with space again equals never stopping."""

    def full(*_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch, pytest.raises(DiskError, match=r"No space left.*000004"):
        go(tmp_path / "a", events={6: lambda: patch.setattr(MetricsFile, "write", full)})
    with monkeypatch.context() as patch, pytest.raises(DiskError, match=r"iteration 8.*000004"):
        go(tmp_path / "b", events={6: lambda: patch.setattr(np, "savez", full)})
    go(tmp_path / "whole")
    for name in "ab":
        assert saved(tmp_path / name) == [4]
        go(tmp_path / f"{name}2", resume=tmp_path / name)
        assert same(tmp_path / "whole", tmp_path / f"{name}2")


def test_what_cannot_work_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    """Each mistake has its sentence, and the folder stays as it was."""
    out = tmp_path / "out"
    with pytest.raises(Sim2RealError, match="no end"):
        go(out, iterations=None)
    with pytest.raises(Sim2RealError, match="checkpoint_every=0"):
        go(out, checkpoint_every=0)
    with pytest.raises(Sim2RealError, match="iterations=-1"):
        go(out, iterations=-1)
    with pytest.raises(CheckpointError, match="does not exist"):
        go(out, resume=tmp_path / "nowhere")
    assert not out.exists()


def test_an_evaluation_that_cannot_be_is_refused_before_training(tmp_path: Path) -> None:
    """Its own check is asked before a folder is made."""

    class Never:
        def check(self, algorithm: Algorithm) -> None:
            raise Sim2RealError("no such parameter")

    with pytest.raises(Sim2RealError, match="no such parameter"):
        go(tmp_path / "run", eval=Never())
    assert not (tmp_path / "run").exists()


def test_another_seed_is_refused(tmp_path: Path) -> None:
    """A run goes on with its own luck; the sentence says which seed that is."""
    for name, seed in (("first", 3), ("second", 5)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "config.yaml").write_text(f"seed: {seed}\n")
    go(tmp_path / "first", seed=3)
    with pytest.raises(CheckpointError, match=r"has seed=3, this one seed=5.*give seed=3"):
        go(tmp_path / "second", seed=5, resume=tmp_path / "first")
    assert saved(tmp_path / "second") == []


def test_a_checkpoint_of_another_task_is_refused(tmp_path: Path) -> None:
    """Both tasks are named, and no folder is made."""

    class Elsewhere(Nav2D):
        """Another place."""

    go(tmp_path / "run")
    with pytest.raises(CheckpointError, match="task Nav2D, but this run has task Elsewhere"):
        go(tmp_path / "out", resume=tmp_path / "run", parts=world(Elsewhere))
    assert not (tmp_path / "out").exists()


def test_a_folder_with_a_run_is_not_overwritten(tmp_path: Path) -> None:
    """Training afresh into a folder that holds a run names the way to continue it."""
    go(tmp_path)
    with pytest.raises(CheckpointError, match=r"already holds a run; .*resume="):
        go(tmp_path)


def test_without_graphics_a_run_goes_on_and_says_so(tmp_path: Path, caplog) -> None:
    """A film that cannot be drawn is a line in the log, not the end of the run."""

    class Blind:
        def record(self, *_: Any) -> Path:
            raise RenderError("nothing draws here; install x")

    with caplog.at_level(logging.WARNING):
        go(tmp_path, video=Blind())
    assert "no video: nothing draws here; install x" in caplog.text
