"""Moments at which something stood in a joint's way: an obstacle, the table, a hand.

    logs, found = mark_blocked(logs)        # rows get `flag.blocked`; a finding for each joint

A servo that rests lets friction hold it, which can balance only so much of its effort. Where a
joint stands still much further from its goal than at its other rests, and with far more current,
something else holds it. No effect on the robot explains such rows, and a fit that tries to is
wrong everywhere else: they are left out, with what comes right before and after.

A limit of torque makes errors large, too, but not the current, so that both have to be.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.windows import BLOCKED
from sim2real.diagnosis.schema import Finding

REST, STILL = 0.1, 0.003  # s on either side within which a resting joint moves less [rad, m]
USUAL = 0.9  # quantile of a joint's rests that counts as usual
CURRENT, ERROR = 3.0, 1.6  # times the usual that something else is needed for
NEAR = 0.5  # s before and after that are left out as well
FEW = 50  # rows at rest below which nothing is usual
SHORTEST = 0.2  # s in a log: less is a spike


def mark_blocked(logs: Sequence[Log]) -> tuple[list[Log], list[Finding]]:
    """Return the logs with blocked rows flagged, and what was found.

    Rows that a log flags itself stay flagged. Logs without currents come back as they are.

    Args:
        logs: of one robot.
    """
    flags = [np.array(log.columns.get(BLOCKED, np.zeros(len(log)))) > 0 for log in logs]
    findings = []
    for joint in dict.fromkeys(name for log in logs for name in log.actuators):
        held = _held(logs, joint)
        if any(rows.any() for rows in held):
            findings.append(_finding(logs, joint, held))
            flags = [
                flag | _widened(log, rows)
                for flag, log, rows in zip(flags, logs, held, strict=True)
            ]
    marked = [
        Log({**log.columns, BLOCKED: flag.astype(float)}, log.meta, log.path) if flag.any() else log
        for log, flag in zip(logs, flags, strict=True)
    ]
    return marked, findings


def _held(logs: Sequence[Log], joint: str) -> list[np.ndarray]:
    """Return the rows of each log in which a joint is held by something else, (T,) bool."""
    none = [np.zeros(len(log), bool) for log in logs]
    seen = [(log, _current(log, joint)) for log in logs]
    known = [(log, c) for log, c in seen if c is not None and f"qpos.{joint}" in log.columns]
    if len(known) < len(logs):
        return none
    errors = [np.abs(log.column(f"ctrl.{joint}") - log.column(f"qpos.{joint}")) for log in logs]
    rests = [_resting(log, joint) for log in logs]
    every = np.concatenate(rests)
    if every.sum() < FEW:
        return none
    usual = [
        float(np.quantile(np.concatenate(parts)[every], USUAL))
        for parts in ([c for _, c in known], errors)
    ]
    if min(usual) <= 0:
        return none
    held = [
        rest & (current > CURRENT * usual[0]) & (error > ERROR * usual[1])
        for rest, (_, current), error in zip(rests, known, errors, strict=True)
    ]
    long = [_seconds(log, rows) >= SHORTEST for log, rows in zip(logs, held, strict=True)]
    return [rows & enough for rows, enough in zip(held, long, strict=True)]


def _current(log: Log, joint: str) -> np.ndarray | None:
    """Return the size of a joint's current in any unit, (T,), or None."""
    for name, values in log.columns.items():
        if "current" in name and name.endswith((f".{joint}", f"_{joint}")):
            return np.abs(values)
    return None


def _resting(log: Log, joint: str) -> np.ndarray:
    """Return in which rows a joint stands still with its torque on, (T,) bool."""
    found = []
    for part in log.episodes():
        time, position = part.time, part.column(f"qpos.{joint}")
        first, last = (np.searchsorted(time, time + side) for side in (-REST, REST))
        spans = zip(first, np.minimum(last, len(time) - 1) + 1, strict=True)
        found.append(np.array([np.ptp(position[a:b]) < STILL for a, b in spans]))
    on = log.columns.get(f"torque.{joint}", np.ones(len(log))) > 0
    return np.concatenate(found) & on


def _widened(log: Log, rows: np.ndarray) -> np.ndarray:
    """Return rows with those shortly before and after, (T,) bool."""
    wide = np.zeros(len(log), bool)
    same = log.episode
    for moment, episode in zip(log.time[rows], same[rows], strict=True):
        wide |= (np.abs(log.time - moment) <= NEAR) & (same == episode)
    return wide


def _seconds(log: Log, rows: np.ndarray) -> float:
    """Return how long so many rows of a log last."""
    return float(rows.sum() * np.median(np.diff(log.time)))


def _finding(logs: Sequence[Log], joint: str, held: Sequence[np.ndarray]) -> Finding:
    log, rows = max(zip(logs, held, strict=True), key=lambda pair: int(pair[1].sum()))
    row = int(np.flatnonzero(rows)[0])
    short = abs(float(log.column(f"ctrl.{joint}")[row] - log.column(f"qpos.{joint}")[row]))
    seconds = sum(_seconds(*pair) for pair in zip(logs, held, strict=True))
    name = log.path.name if log.path else "the log"
    return Finding(
        "blocked",
        joint,
        f"{joint} stands still {short:.2g} short of its goal, with more than {CURRENT:g} times the "
        f"current of its other rests, for {seconds:.1f} s in all, first at {log.time[row]:.1f} s "
        f"of {name}: something is in its way.",
        "These moments are left out. Look at what the robot touches there; a log may flag such "
        f"rows itself, in a column {BLOCKED}.",
    )
