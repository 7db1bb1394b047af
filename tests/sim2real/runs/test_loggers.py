"""Metrics reach their places; a place that is not there is refused before any work."""

import importlib.util
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from sim2real.runs.loggers import Logger, LoggerError, Loggers, MLflow, TensorBoard, WandB


class Memory(Logger):
    """A logger that remembers."""

    package, extra = "json", "memory"

    def _make(self, out: Path, name: str) -> Any:
        self.name, self.said, self.closed = name, [], False
        return self

    def log_hparams(self, config: dict[str, Any]) -> None:
        """Remember the configuration."""
        self.config = config

    def log_scalar(self, name: str, value: float, step: int) -> None:
        """Remember a number."""
        self.said.append((name, value, step))

    def close(self) -> None:
        """Remember the end."""
        self.closed = True


class Broken(Memory):
    """A logger whose service is down."""

    def _make(self, out: Path, name: str) -> Any:
        raise ConnectionError("no answer")


def test_metrics_reach_every_logger(tmp_path: Path) -> None:
    """Each gets every metric with its step, the name of the run and the flat configuration."""
    first, second = Memory(), Memory()
    out = tmp_path / "train" / "smoke" / "now"
    with Loggers([first, second]).opened(
        out, {"seed": 3, "env": {"task": {"steps": 5}, "draws": []}}
    ) as loggers:
        loggers.log({"train/return": 1.5, "train/frames": 10}, step=2)
    for logger in (first, second):
        assert logger.said == [("train/return", 1.5, 2), ("train/frames", 10.0, 2)]
        assert logger.name == "train_smoke_now" and logger.closed
        assert logger.config == {"seed": 3, "env.task.steps": 5, "env.draws": "[]"}


def test_loggers_close_whatever_happens(tmp_path: Path) -> None:
    """An interrupted run leaves no open logger."""
    logger = Memory()
    with pytest.raises(KeyboardInterrupt), Loggers([logger]).opened(tmp_path):
        raise KeyboardInterrupt
    assert logger.closed


def test_a_service_that_is_down_is_said(tmp_path: Path) -> None:
    """The sentence names the logger and the way round it, and the loggers before it are closed."""
    first = Memory()
    with (
        pytest.raises(LoggerError, match=r"no answer.*logger=csv"),
        Loggers([first, Broken()]).opened(tmp_path),
    ):
        pass
    assert first.closed


@pytest.mark.parametrize(("kind", "extra"), [(WandB, "wandb"), (MLflow, "mlflow")])
def test_a_missing_package_names_its_extra(kind: Any, extra: str, monkeypatch) -> None:
    """Without its package a logger cannot be made, and the sentence says what to install."""
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(LoggerError, match=rf"sim2real\[{extra}\]"):
        kind("sim2real", None)


def test_tensorboard_files_hold_the_metrics(tmp_path: Path) -> None:
    """What is logged can be read back from the event files."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    with Loggers([TensorBoard()]).opened(tmp_path, {"seed": 0}) as loggers:
        for step in (1, 2):
            loggers.log({"train/return": step / 4}, step)
    events = EventAccumulator(str(tmp_path / "tensorboard"))
    events.Reload()
    assert [(e.step, e.value) for e in events.Scalars("train/return")] == [(1, 0.25), (2, 0.5)]


def test_a_logger_of_torchrl_s_interface_gets_the_metrics(tmp_path: Path) -> None:
    """Any class that is made of a name and a folder, such as TorchRL's CSV files."""
    from torchrl.record.loggers import CSVLogger

    with Loggers([partial(CSVLogger)]).opened(tmp_path, {"seed": 3}) as loggers:
        loggers.log({"train/return": 12.5}, step=7)
    (written,) = tmp_path.rglob("return.csv")
    step, value = written.read_text(encoding="utf-8").strip().split(",")
    assert (int(step), float(value)) == (7, 12.5)
