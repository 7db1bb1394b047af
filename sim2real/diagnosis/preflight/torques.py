"""Torques that were never measured: columns that are the servo's law, computed from other columns.

    findings = check_torques(pairs, settings)

Drivers without a current sensor, and simulators, log kp (command - position) - kd speed under the
name of a torque. Such a column repeats what the others say: it is no evidence of what the motor
did, and no residual of it is shown. A measured one has noise of its own, which no law explains.
"""

from collections.abc import Iterator

import mujoco
import numpy as np

from hardware.formats.names import IMPEDANCE_KINDS
from hardware.log import Log
from sim2real.diagnosis.data.pairs import Pairs, driven_by
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, TINY, Preflight, Settings

MEASURED = ("torque", "effort", "current", "load")  # how columns of a motor's torque are named


def check_torques(pairs: Pairs, settings: Settings = DEFAULT) -> Iterator[Finding]:
    """Yield a finding for each actuator's column of torque that its other columns explain."""
    for name, column in computed_torques(pairs, settings.preflight).items():
        yield Finding(
            "computed_torque",
            name,
            f"`{column}` is the law of {name} to the last digits: it was computed from the command "
            "and the position, not measured.",
            "Nothing to mend; it is not used as evidence. Log the motor's current if the driver "
            "reads it.",
        )


def computed_torques(pairs: Pairs, settings: Preflight = DEFAULT.preflight) -> dict[str, str]:
    """Return the column of each actuator's torque that was computed in every log that has it."""
    found: dict[str, list[tuple[str, bool]]] = {}
    for log, model in pairs:
        for name in log.actuators:
            column = torque_column(log, name)
            if column is not None:
                own = _is_law(log, model, name, column, settings)
                found.setdefault(name, []).append((column, own))
    return {name: own[0][0] for name, own in found.items() if all(law for _, law in own)}


def torque_column(log: Log, actuator: str) -> str | None:
    """Return the column that calls itself an actuator's torque or current; None: there is none."""
    names = [f"current.{actuator}"]
    names += [f"sensor.{kind}{sign}{actuator}" for kind in MEASURED for sign in "_."]
    return next((name for name in names if name in log.columns), None)


def _is_law(
    log: Log, model: mujoco.MjModel, actuator: str, column: str, settings: Preflight
) -> bool:
    """Return whether command, position and speed of the same rows leave nothing of a column."""
    driven, wanted = driven_by(model, actuator), log.column(column)
    empty = len(log) < settings.rows_min or np.ptp(wanted) < TINY
    if driven is None or empty or wanted.min() >= 0:
        return False
    free = np.abs(wanted) < np.abs(wanted).max() * settings.saturated
    ctrl, q = log.column(f"ctrl.{actuator}"), log.column(f"qpos.{driven[1]}")
    slopes = [np.gradient(p.column(f"qpos.{driven[1]}"), p.time) for p in log.episodes()]
    speed = log.columns.get(f"qvel.{driven[1]}", np.concatenate(slopes))
    none = np.zeros(len(log))
    kp, kd, wish, ahead = (log.columns.get(f"{k}.{actuator}", none) for k in IMPEDANCE_KINDS)
    terms = [ctrl, q, speed]
    if f"kp.{actuator}" in log.columns:
        terms = [kp * (ctrl - q), kd * (wish - speed), ahead]
    table = np.column_stack([*terms, np.ones(len(log))])[free]
    weights, *_ = np.linalg.lstsq(table, wanted[free])
    rest = wanted[free] - table @ weights
    return float(rest.std()) < settings.computed * float(wanted[free].std())


def measured_torques(pairs: Pairs, settings: Preflight = DEFAULT.preflight) -> dict[str, str]:
    """Return the column of each actuator's torque or current that is evidence: signed, measured."""
    computed, found = computed_torques(pairs, settings), {}
    for log, _ in pairs:
        for name in log.actuators:
            column = torque_column(log, name)
            if column is not None and name not in computed and log.column(column).min() < 0:
                found.setdefault(name, column)
    return found
