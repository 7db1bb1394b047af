"""A policy's commands in an episode with torque off, from its log.

tell_commands(rows.log.last, out)           # out/dry_run.md and .csv, and the same as log lines
"""

import logging
from pathlib import Path

import numpy as np

from hardware.log import Log
from sim2real.runs.tables import Table

log_ = logging.getLogger(__name__)


def commands(log: Log) -> Table:
    """Return a row for each servo: goals, steps and distances that would have been commanded."""
    table = Table(
        (
            "servo",
            "least goal [rad]",
            "largest goal [rad]",
            "largest step [rad]",
            "farthest from where it is [rad]",
            "rows limited",
        )
    )
    for servo, joint in zip(log.actuators, log.joints, strict=True):
        goal, wanted = log.column(f"ctrl.{servo}"), log.column(f"action.{servo}")
        off = np.abs(goal - log.column(f"qpos.{joint}")).max()
        step = np.abs(np.diff(goal)).max()
        limited = int((np.abs(goal - wanted) > 1e-3).sum())
        table.add(servo, float(goal.min()), float(goal.max()), float(step), float(off), limited)
    table.notes.append("Torque was off: nothing of this was sent. The last episode of the dry run.")
    return table


def tell_commands(log: Log | None, out: Path) -> None:
    """Write the table and say it; does nothing without a log."""
    if log is None:
        return
    table = commands(log)
    table.write(out / "dry_run")
    for servo, low, high, step, off, limited in table.rows:
        log_.info(
            "%s would have been commanded to %.3f to %.3f rad, by at most %.3f rad a step and "
            "%.3f rad from where it is; %d rows limited",
            servo,
            low,
            high,
            step,
            off,
            limited,
        )
