"""Loggers in addition to metrics.csv: TensorBoard, Weights & Biases, MLflow, by TorchRL.

    with Loggers([TensorBoard()]).opened(out, config={"seed": 0}) as loggers:
        loggers.log({"train/return": 12.5}, step=1)

`metrics.csv` (see `sim2real.runs.metrics`) is the record that a resumed run continues without a
seam; these are views of it. A resumed run has its own folder, and so its own view, which
starts at the step where it goes on.
"""

from __future__ import annotations

import importlib
import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from sim2real.runs.errors import Sim2RealError
from sim2real.runs.tree import flatten


class LoggerError(Sim2RealError):
    """A logger needs a package that is not installed, or its service refuses."""


class Logger(ABC):
    """A place for metrics; its optional package is looked for when it is made, before any work."""

    package: str
    extra: str

    def __init__(self) -> None:
        if importlib.util.find_spec(self.package) is None:
            raise LoggerError(
                f"logger={self.extra} needs the package {self.package!r}, which is not installed; "
                f"install it with: pip install 'sim2real[{self.extra}]'"
            )
        self._sink: Any = None

    def open(self, out: Path, config: Mapping[str, Any]) -> None:
        """Start.

        Args:
            out: the run's folder; its last three parts name the run.
            config: what the run was started with, to be shown with its metrics.

        Raises:
            LoggerError: when the service cannot be used.
        """
        try:
            self._sink = self._make(out, "_".join(out.absolute().parts[-3:]))
            if config:
                self._sink.log_hparams(_plain(config))
        except (
            Exception
        ) as error:  # each service has its own; whichever it is, the remedy is the same
            raise LoggerError(
                f"logger={self.extra} could not start ({error}); fix it, or choose logger=csv"
            ) from error

    @abstractmethod
    def _make(self, out: Path, name: str) -> Any: ...

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        """Record metrics of a step."""
        for name, value in metrics.items():
            self._sink.log_scalar(name, float(value), step=step)

    def close(self) -> None:
        """Flush and close the logger."""
        self._sink = None


class TensorBoard(Logger):
    """Event files in the run's folder; `tensorboard --logdir outputs` shows them."""

    package = extra = "tensorboard"

    def _make(self, out: Path, name: str) -> Any:
        loggers = importlib.import_module("torchrl.record.loggers.tensorboard")
        return loggers.TensorboardLogger(exp_name="tensorboard", log_dir=str(out))

    def close(self) -> None:
        """Flush and close the logger."""
        if self._sink is not None:
            self._sink.experiment.close()
        super().close()


class WandB(Logger):
    """A run of Weights & Biases.

    Args:
        project: that it appears in.
        offline: keep it in the run's folder, to be sent later.
    """

    package = extra = "wandb"

    def __init__(self, project: str, offline: bool) -> None:
        super().__init__()
        self.project, self.offline = project, offline

    def _make(self, out: Path, name: str) -> Any:
        loggers = importlib.import_module("torchrl.record.loggers.wandb")
        return loggers.WandbLogger(
            exp_name=name, save_dir=str(out), project=self.project, offline=self.offline
        )

    def close(self) -> None:
        """Flush and close the logger."""
        if self._sink is not None:
            self._sink.experiment.finish()
        super().close()


class MLflow(Logger):
    """A run of MLflow.

    Args:
        experiment: that it appears in.
        tracking_uri: server or database; None for mlflow.db in the run's folder.
    """

    package = extra = "mlflow"

    def __init__(self, experiment: str, tracking_uri: str | None) -> None:
        super().__init__()
        self.experiment, self.tracking_uri = experiment, tracking_uri

    def _make(self, out: Path, name: str) -> Any:
        loggers = importlib.import_module("torchrl.record.loggers.mlflow")
        uri = self.tracking_uri or f"sqlite:///{out.absolute() / 'mlflow.db'}"
        return loggers.MLFlowLogger(exp_name=self.experiment, tracking_uri=uri)

    def close(self) -> None:
        """Flush and close the logger."""
        if self._sink is not None:
            importlib.import_module("mlflow").end_run()
        super().close()


class TorchRLLogger(Logger):
    """A run of any logger with TorchRL's interface, one's own included.

    Args:
        make: makes it from `exp_name` and `log_dir`, as `torchrl.record.loggers.CSVLogger` is made.
    """

    package = extra = "torchrl"

    def __init__(self, make: Callable[..., Any]) -> None:
        super().__init__()
        self._made = make

    def _make(self, out: Path, name: str) -> Any:
        return self._made(exp_name=name, log_dir=str(out))


class Loggers:
    """Several loggers as one.

    Args:
        loggers: may be empty; a `partial` makes a logger of TorchRL's interface, see
            `TorchRLLogger`.
    """

    def __init__(self, loggers: Sequence[Logger | partial[Any]]) -> None:
        self.loggers = tuple(TorchRLLogger(o) if isinstance(o, partial) else o for o in loggers)

    @contextmanager
    def opened(self, out: Path, config: Mapping[str, Any] | None = None) -> Iterator[Loggers]:
        """Open all of them for a run in the folder `out`; close them whatever ends the block."""
        started: list[Logger] = []
        try:
            for logger in self.loggers:
                started.append(logger)
                logger.open(out, config or {})
            yield self
        finally:
            for logger in started:
                logger.close()

    def log(self, metrics: Mapping[str, float], step: int) -> None:
        """Record metrics of a step everywhere."""
        for logger in self.loggers:
            logger.log(metrics, step)


def _plain(config: Mapping[str, Any]) -> dict[str, bool | int | float | str]:
    """Return settings by dotted name; what is not a number, text or truth becomes text."""
    items = flatten(config).items()
    return {k: v if isinstance(v, bool | int | float | str) else str(v) for k, v in items}
