"""Between two episodes: the parameters that a policy's environment draws, as the logs say them.

    find = EpisodeIdentifier(Nearby(rows=1, transitions=50))
    find(trained.environment, logs, seed=0)             # (P,), each in its unit

The logs are replayed in the task that the policy was trained in; what training draws is the prior.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from envs.models import named
from envs.plant import Fixed
from envs.randomization import Tasks
from envs.tasks.base import Task
from hardware.log import Log
from sim2real.identification.data import Recordings
from sim2real.identification.methods.base import FitContext, Method
from sim2real.identification.prior import prior_from_tasks
from sim2real.runs.errors import Sim2RealError


class Simulated(Protocol):
    """A policy's training environment; see `sim2real.learning.environment.EnvironmentFactory`."""

    tasks: Tasks
    fixed: Sequence[Fixed]

    @property
    def task(self) -> Task | None:
        """The simulated task."""
        ...


class EpisodeIdentifier:
    """Identifies by a method.

    Args:
        method: how; its provider must replay logs.
        beyond: how far beyond the ranges of training a value may be found, in their widths. A robot
            out of one range would else be given wrong values of all others.

    Raises:
        Sim2RealError: a negative `beyond`.
    """

    def __init__(self, method: Method, beyond: float = 0.0) -> None:
        if not beyond >= 0:
            raise Sim2RealError(f"adapt.find.beyond={beyond:g} must not be below 0")
        self._method, self._beyond = method, beyond

    def __call__(self, environment: Simulated, logs: Sequence[Log], seed: int) -> np.ndarray:
        """Return the means of what the method finds, (P,).

        Args:
            environment: what the policy was trained in.
            logs: of one robot.
            seed: of all that is random.

        Raises:
            Sim2RealError: a world without a robot, or what `Recordings` and the method refuse.
        """
        task = environment.task
        if task is None:
            raise Sim2RealError(
                "adapt=identify replays logs in a simulated robot, but there is none"
            )
        with tempfile.TemporaryDirectory() as folder:
            model = Path(folder, "model.xml")
            model.write_text(named(task.spec()).to_xml(), encoding="utf-8")
            data = Recordings(logs, model, environment.fixed)
            prior = prior_from_tasks(environment.tasks, data, self._beyond)
            return self._method.fit(self._method.provider, prior, data, FitContext(seed)).mean
