"""Sweeps whose jobs run in processes of their own.

`conf/config.yaml` names `SparedWorkers` among Hydra's callbacks.
"""

from typing import Any

from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from sim2real.runs.stopping import spare_children

SIDE_BY_SIDE = "JoblibLauncher"


class SparedWorkers(Callback):
    """Lets Ctrl-C reach a sweep's own process alone, which then ends those of its jobs.

    They would write a traceback each, whether they import, wait or train.
    """

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Spare the processes of a sweep that runs jobs side by side."""
        if str(config.hydra.launcher._target_).endswith(SIDE_BY_SIDE):
            spare_children()
