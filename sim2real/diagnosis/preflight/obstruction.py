"""Moments at which something stood in a joint's way: an obstacle, the table, a hand.

    logs, found = mark_blocked(logs, driven)    # rows get `flag.blocked`; a finding for each joint

A servo that rests lets friction hold it, which can balance only so much of its effort. Where a
joint stands still further from its goal than at its other rests, and with far more current,
something else holds it. No effect on the robot explains such rows, and a fit that tries to is
wrong everywhere else: they are left out, with what comes right before and after.

A limit of torque makes errors large, too, but not the current, so that both have to be.
"""

import re
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from envs.replay.recording import ROUNDING
from hardware.log import Log
from sim2real.diagnosis.data.pairs import name_of
from sim2real.diagnosis.data.recording import BLOCKED, flagged, is_flagged, powered
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Settings


def positioned(log: Log, spec: mujoco.MjSpec) -> dict[str, str]:
    """Return the joint of each actuator whose command is a desired position.

    A motor's command is a torque, unless the log's rows bring gains.
    """
    return {
        one.name: one.target
        for one in spec.actuators
        if one.trntype == mujoco.mjtTrn.mjTRN_JOINT
        and (one.biastype != mujoco.mjtBias.mjBIAS_NONE or f"kp.{one.name}" in log.columns)
    }


def mark_blocked(
    logs: Sequence[Log], driven: Mapping[str, str], settings: Settings = DEFAULT
) -> tuple[list[Log], list[Finding]]:
    """Return the logs with blocked rows flagged, and what was found.

    Rows that a log flags itself stay flagged. Logs without currents come back as they are.
    `driven` is the joint that each actuator drives by desired positions.
    """
    flags = [is_flagged(log, BLOCKED) for log in logs]
    findings = []
    for servo in driven.items():
        held = _held(logs, servo, settings)
        if any(rows.any() for rows in held):
            findings.append(_finding(logs, servo, held, settings.obstruction.current))
            for flag, log, rows in zip(flags, logs, held, strict=True):
                flag |= _widened(log, rows, settings.windows.kick_s)
    return [flagged(log, BLOCKED, own) for log, own in zip(logs, flags, strict=True)], findings


def _held(logs: Sequence[Log], servo: tuple[str, str], settings: Settings) -> list[np.ndarray]:
    """Return the rows of each log, (T,) bool, in which a joint is held by something else.

    None of any log where currents or positions are missing, or the joint hardly rests.
    """
    columns = {f"ctrl.{servo[0]}", f"qpos.{servo[1]}"}
    currents = [c for log in logs if (c := _current(log, servo)) is not None]
    if len(currents) < len(logs) or not all(columns <= log.columns.keys() for log in logs):
        return []
    errors = [_error(log, servo) for log in logs]
    rests = [_resting(log, servo, settings) for log in logs]
    every = np.concatenate(rests)
    if every.sum() < settings.preflight.rows_min:
        return []
    current, error = (
        float(np.quantile(np.concatenate(parts)[every], 1 - 2 * settings.inference.level))
        for parts in (currents, errors)
    )
    if min(current, error) <= 0:
        return []
    much, far = settings.obstruction.current * current, error + settings.regimes.goal_error
    held = []
    for log, rest, own, off in zip(logs, rests, currents, errors, strict=True):
        rows = rest & (own > much) & (off > far)
        held.append(rows & (_seconds(log, rows) >= 2 * settings.obstruction.rest_s))
    return held


def _error(log: Log, servo: tuple[str, str]) -> np.ndarray:
    """Return how far a joint is from its servo's goal [rad or m], (T,)."""
    return np.abs(log.column(f"ctrl.{servo[0]}") - log.column(f"qpos.{servo[1]}"))


def _current(log: Log, servo: tuple[str, str]) -> np.ndarray | None:
    """Return the size of a servo's current in any unit, (T,), or None.

    Columns are `current.<name>` or `sensor.current_<name>`, with `raw` or a unit in between, of the
    actuator's name or the joint's.
    """
    names = "|".join(map(re.escape, servo))
    column = re.compile(rf"(.*[._])?current([._](raw|mA|A))?[._]({names})")
    for name, values in log.columns.items():
        if column.fullmatch(name):
            return np.abs(values)
    return None


def _resting(log: Log, servo: tuple[str, str], settings: Settings) -> np.ndarray:
    """Return in which rows a joint stands still with its torque on, (T,) bool."""
    found, side, same = [], settings.obstruction.rest_s, settings.preflight.same_command
    for part in log.episodes():
        time, position = part.time, part.column(f"qpos.{servo[1]}")
        first, last = (np.searchsorted(time, time + s - ROUNDING) for s in (-side, side))
        spans = zip(first, np.minimum(last, len(time) - 1) + 1, strict=True)
        found.append(np.array([np.ptp(position[a:b]) <= same for a, b in spans]))
    return np.concatenate(found) & powered(log, servo[0])


def _widened(log: Log, rows: np.ndarray, margin: float) -> np.ndarray:
    """Return rows with those within a margin [s] of them, (T,) bool."""
    wide = np.zeros(len(log), bool)
    for moment, episode in zip(log.time[rows], log.episode[rows], strict=True):
        wide |= (np.abs(log.time - moment) <= margin + ROUNDING) & (log.episode == episode)
    return wide


def _seconds(log: Log, rows: np.ndarray) -> float:
    """Return how long so many rows of a log last."""
    return float(rows.sum() * np.median(np.diff(log.time)))


def _finding(
    logs: Sequence[Log], servo: tuple[str, str], held: Sequence[np.ndarray], times: float
) -> Finding:
    log, rows = max(zip(logs, held, strict=True), key=lambda pair: int(pair[1].sum()))
    row = int(np.flatnonzero(rows)[0])
    seconds = sum(_seconds(*pair) for pair in zip(logs, held, strict=True))
    return Finding(
        "blocked",
        servo[1],
        f"{servo[1]} stands still {_error(log, servo)[row]:.2g} short of its goal, with more than "
        f"{times:g} times the current of its other rests, for {seconds:.1f} s in all, "
        f"first at {log.time[row]:.1f} s of {name_of(log)}: something is in its way.",
        "These moments are left out. Look at what the robot touches there; a log may flag such "
        f"rows itself, in a column {BLOCKED}.",
    )
