"""Logs as they are compared, and what is wrong with them before any physics is.

prepared = prepare(logs, model, fixed, settings, on_progress)
prepared.data, prepared.findings
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import mujoco

from envs.plant import Fixed
from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.progress import Progress
from sim2real.diagnosis.data.recording import load_model
from sim2real.diagnosis.data.refuse import refuse_clock, refuse_kinds
from sim2real.diagnosis.ground.estimate import estimate_all
from sim2real.diagnosis.ground.findings import check_ground
from sim2real.diagnosis.ground.pushes import check_pushes
from sim2real.diagnosis.ground.windows import grounded
from sim2real.diagnosis.preflight.checks import preflight
from sim2real.diagnosis.preflight.hunting import mark_hunting
from sim2real.diagnosis.preflight.obstruction import mark_blocked, positioned
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import Settings


class PreparedLogs(NamedTuple):
    """Logs before any cause is looked for."""

    logs: Sequence[Log]  # without what obstructed or hunting moments would spoil
    data: Data  # their windows
    specs: list[mujoco.MjSpec]  # the model of each log
    driven: dict[str, str]  # the joint that each actuator drives by desired positions
    findings: list[Finding]  # of preflight
    restart: Callable[[Sequence[Fixed]], Data] | None
    """Makes the windows anew with effects in the model, where nobody measured the base."""


def prepare(
    logs: Sequence[Log],
    model: str | Path | None,
    fixed: Sequence[Fixed],
    settings: Settings,
    on_progress: Progress,
) -> PreparedLogs:
    """Return logs as they are compared, and what is wrong with them before any physics is.

    `fixed` are effects that are in the model already; without a model each log names its own.

    Raises:
        Sim2RealError: logs of a kind that the model lacks, joints that never moved.
    """
    driven = {}
    for log in logs:
        refuse_clock(log, settings)
        driven |= positioned(log, load_model(log, model))
    logs, held = mark_blocked(logs, driven, settings)
    logs, hunts = mark_hunting(logs, driven, settings)
    estimates = estimate_all(logs, model, settings.ground)
    logs = [one.log for one in estimates] or logs
    given = data = Data.of(logs, model, settings)
    logs = given.logs
    if estimates:
        on_progress("estimating where the base was", 0.0)
        data = grounded(given, estimates, fixed)
    specs = [data.specs[index] for index in data.which]
    for log, spec in zip(logs, specs, strict=True):
        refuse_kinds(log, spec, settings)
    findings = [
        *held,
        *hunts,
        *preflight(logs, specs, settings),
        *check_ground(estimates, data.log_models, settings.ground),
        *check_pushes(data, estimates),
    ]
    restart = partial(grounded, given, estimates) if estimates else None
    return PreparedLogs(logs, data, specs, driven, findings, restart)
