"""Sweeps: the processes of their jobs, and what becomes of a job that fails.

`conf/config.yaml` names `SparedWorkers` and `FailedJobs` among Hydra's callbacks.
"""

import logging
import os
from importlib import import_module
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from sim2real.runs.errors import Refused
from sim2real.runs.stopping import spare_children

FAILED = "failed.txt"  # in a sweep's folder, which processes of all jobs share: a line for each
SIDE_BY_SIDE = "JoblibLauncher"
GLFW = "PYGLFW_LIBRARY"  # where GLFW, which MuJoCo imports, is


class SparedWorkers(Callback):
    """Lets Ctrl-C reach a sweep's own process alone, which then ends those of its jobs.

    They would write a traceback each, whether they import, wait or train.
    """

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Spare the processes of a sweep that runs jobs side by side."""
        if str(config.hydra.launcher._target_).endswith(SIDE_BY_SIDE):
            spare_children()
            find_glfw()


def find_glfw() -> None:
    """Look for GLFW here, for the processes of all jobs.

    Each would start a process that looks for it, whose input never comes where the job is ended.
    """
    found = import_module("glfw.library").glfw
    if found is not None:
        os.environ.setdefault(GLFW, found._name)


class FailedJobs(Callback):
    """Ends a sweep with a list of its failed jobs, after the others have run."""

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Remove the list of an earlier sweep in the same folder."""
        (Path(config.hydra.sweep.dir) / FAILED).unlink(missing_ok=True)

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Raise Refused if a job has failed."""
        file = Path(config.hydra.sweep.dir) / FAILED
        if file.exists():
            lines = file.read_text(encoding="utf-8").splitlines()
            raise Refused("\n".join([f"{len(lines)} of the sweep's jobs failed:", *lines]))


def note_failure(error: Exception, sentence: str | None) -> None:
    """Log why a sweep's job failed, and add it to the list of `FailedJobs`.

    Args:
        error: why.
        sentence: the same for a user; None for a defect, which is logged with its traceback.
    """
    hydra = HydraConfig.get()
    why = " ".join((sentence or f"{type(error).__name__}: {error}").split())
    line = f"job {hydra.job.num} ({' '.join(hydra.overrides.task)}) failed: {why}"
    logging.getLogger("sim2real").error(line, exc_info=None if sentence else error)
    with (Path(hydra.sweep.dir) / FAILED).open("a", encoding="utf-8") as file:
        file.write(f"{line}\n")
