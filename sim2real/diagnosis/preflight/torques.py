"""Torques that were never measured: columns that are the servo's law, computed from other columns.

    findings = check_torques(pairs, settings)

Drivers without a current sensor, and simulators, log kp (command - position) - kd speed under the
name of a torque. Such a column repeats what the others say: it is no evidence of what the motor
did, and no residual of it is shown. A measured one has noise of its own, which no law explains.
"""

from collections.abc import Iterator

import numpy as np

from hardware.formats.names import IMPEDANCE_KINDS
from hardware.log import Log
from sim2real.diagnosis.data.pairs import Pairs, actuators_of, commands_of
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
    found = {}
    for name in actuators_of(pairs):
        logs = [(log, joint, _column(log, name)) for log, _, _, joint in commands_of(pairs, name)]
        own = [(log, joint, column) for log, joint, column in logs if column is not None]
        if own and all(_is_law(name, settings, *one) for one in own):
            found[name] = own[0][2]
    return found


def _column(log: Log, actuator: str) -> str | None:
    """Return the column that calls itself an actuator's torque or current; None: there is none."""
    names = [f"current.{actuator}"]
    names += [f"sensor.{kind}{sign}{actuator}" for kind in MEASURED for sign in "_."]
    return next((name for name in names if name in log.columns), None)


def _is_law(actuator: str, settings: Preflight, log: Log, joint: str, column: str) -> bool:
    """Return whether command, position and speed of the same rows leave nothing of a column."""
    wanted = log.column(column)
    if wanted.min() >= 0 or np.ptp(wanted) < TINY or len(log) < settings.rows_min:
        return False
    free = np.abs(wanted) < np.abs(wanted).max() * settings.saturated
    ctrl, q = log.column(f"ctrl.{actuator}"), log.column(f"qpos.{joint}")
    slopes = [np.gradient(part.column(f"qpos.{joint}"), part.time) for part in log.episodes()]
    speed = log.columns.get(f"qvel.{joint}", np.concatenate(slopes))
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
            column = _column(log, name)
            if column is not None and name not in computed and log.column(column).min() < 0:
                found.setdefault(name, column)
    return found
