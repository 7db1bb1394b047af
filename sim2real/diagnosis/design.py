"""The next recording for what a diagnosis leaves open.

plan = design(found, logs, spec, rng=rng)
"""

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from hardware.config import Robot, load_robot
from hardware.errors import HardwareError
from hardware.log import Log
from sim2real.diagnosis.data.trial import choose
from sim2real.diagnosis.experiments.next_experiment import Experiment, next_experiment
from sim2real.diagnosis.outcome import Diagnosis
from sim2real.diagnosis.settings import DEFAULT, Settings


def design(
    found: Diagnosis,
    logs: Sequence[Log],
    spec: mujoco.MjSpec,
    *,
    rng: np.random.Generator,
    robot: Robot | None = None,
    settings: Settings = DEFAULT,
    **options: Any,
) -> Experiment:
    """Return what to record next; the liveliest pieces of the logs hold the refits in place.

    Args:
        found: a diagnosis that leaves several explanations open.
        logs: recordings of one model.
        spec: this model.
        rng: the random generator of drawn motions.
        robot: its limits and rate; None: the one that the logs name, if it is known here.
        settings: see `next_experiment`.
        options: its other ones.

    Raises:
        Sim2RealError: see `next_experiment`.
    """
    model: mujoco.MjModel = spec.copy().compile()
    pieces = choose(logs, settings.simulation.piece_s)
    return next_experiment(
        found.equivalents,
        spec,
        found.floors,
        rng=rng,
        robot=robot or _named(logs[0]),
        fixed=found.known,
        past=[piece.recording(model) for piece in pieces],
        settings=settings.experiment,
        **options,
    )


def _named(log: Log) -> Robot | None:
    """Return the robot that a log names, if its file is one that drives this log's actuators."""
    name = str(log.meta.get("robot"))
    if not name.isidentifier():  # a log's words are data: none of them is read as a path
        return None
    try:
        robot = load_robot(name, needs_model=False)
    except HardwareError:
        return None
    return robot if set(robot.names) == set(log.actuators) else None
