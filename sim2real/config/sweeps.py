"""Sweeps whose jobs run in processes of their own.

`conf/config.yaml` names `SparedWorkers` among Hydra's callbacks.
"""

import os
from importlib import import_module
from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from sim2real.runs.stopping import spare_children

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
