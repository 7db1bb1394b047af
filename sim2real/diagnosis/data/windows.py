"""One window of a log: the piece of an episode that a replay is compared with.

    windows = cut(logs, which, models, joints)

Windows are about evenly long and start at moments of little motion. If servos correct errors,
windows last seconds and have a warm-up; if not, and the whole state is logged, they are short.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import mujoco
import numpy as np

from envs.effects.servo import is_joint_servo
from envs.models import FREE
from envs.replay import Recording
from envs.replay.recording import ROUNDING
from hardware.log import Log
from sim2real.diagnosis.data.recording import (
    BLOCKED,
    HUNTING,
    columns_of,
    episode_rows,
    is_flagged,
    powered,
    to_recording,
)
from sim2real.diagnosis.data.speeds import NEAR
from sim2real.diagnosis.settings import DEFAULT, TINY, Windows
from sim2real.runs.errors import Sim2RealError

HALF = 0.5  # of a window's rows
BEFORE = 0.1  # of the time that is left out after a servo is switched on, is left out before


class Joint(NamedTuple):
    """One compared position."""

    name: str  # as in the column qpos.<name>
    qpos: int  # its place in the model's qpos
    unit: str  # rad or m
    count: float  # the step between two readings; 0 where they are not rounded
    spread: float  # standard deviation of its motion
    scale: float  # what errors are divided by, so that rad and m meet
    floor: float = 0.0  # noise that is known beforehand


class Window(NamedTuple):
    """One piece of an episode; `recording` starts at its warm-up."""

    log: int
    episode: int
    model: int
    start: int  # row at which its replay starts
    first: int  # row of the log at which the comparison starts
    last: int  # row after the last compared one
    recording: Recording
    sample: np.ndarray  # (T, M) s from the recording's start: when each joint was read
    measured: np.ndarray  # (T, M)
    usable: np.ndarray  # (T,) whether a row is compared
    lively: float  # how fast the commands move
    off: float  # share of the time without torque


def cut(
    logs: Sequence[Log],
    which: Sequence[int],
    models: Sequence[mujoco.MjModel],
    joints: Sequence[Joint],
    settings: Windows = DEFAULT.windows,
) -> list[Window]:
    """Return the windows of all logs, whose models are those of the numbers in `which`.

    Raises:
        Sim2RealError: a log too short to be cut, or blocked nearly throughout.
    """
    servo = all(is_driven(models[0], joint.qpos) for joint in joints)
    # Windows keep an error of their starts that no servo and no logged speed corrects. Not so where
    # a base is loose: what it does at a contact hangs on less than is known.
    known = any(f"qvel.{joint.name}" in log.columns for log in logs for joint in joints)
    state = settings.state_s if known or FREE in models[0].jnt_type else settings.unsure_s
    ahead = (settings.warm_s if servo else 0.0) + ROUNDING
    parts = [
        (n, part, own.start)
        for n, log in enumerate(logs)
        for part, own in zip(log.episodes(), episode_rows(log), strict=True)
    ]
    total = sum(part.time[-1] - part.time[0] for _, part, _ in parts)
    windows = []
    for number, part, start in parts:
        slow = min(total / settings.windows_min, _pace(part, settings))
        most, usual = max(settings.longest_s, slow), total / settings.windows_usual
        length = float(np.clip(usual, settings.shortest_s, most)) if servo else state
        pieces = max(1, round(float(part.time[-1] - part.time[0]) / length))
        cuts = _cuts(part, joints, pieces, settings) if servo else _even(part, pieces)
        own = which[number]
        cuts[0] = _first_row(part, models[own])
        for first, last in pairwise(_anew(part, cuts, settings)):
            warm = max(int(np.searchsorted(part.time, part.time[first] - ahead)), int(cuts[0]))
            last = warm + _calm_rows(part, warm, last, settings)
            if last - first > 1 and is_flagged(part, BLOCKED)[first:last].mean() < HALF:
                rows = (start + warm, start + first, start + last)
                args = (logs[number], number, own, models[own], joints, rows, settings)
                windows.append(cut_one(*args))
    empty = [n for n in range(len(logs)) if all(window.log != n for window in windows)]
    if empty:
        place = logs[empty[0]].path or f"log {empty[0] + 1} of {len(logs)}"
        raise Sim2RealError(
            f"{place}: no piece of its {len(logs[empty[0]])} rows can be compared: it is too "
            f"short, or {BLOCKED} is set in most rows; record a few seconds, or remove it"
        )
    return windows


def _first_row(part: Log, model: mujoco.MjModel) -> int:
    """Return the row at which an episode's first replay starts.

    It may begin in motion. Where no servo moves a joint and no column holds its speed, only rows
    with neighbours on both sides tell how fast it is.
    """
    for joint in range(model.njnt):
        places, speeds = columns_of(model, joint)
        known = is_driven(model, int(model.jnt_qposadr[joint])) or all(
            f"qvel.{name}" in part.columns for name in speeds
        )
        if not known and any(f"qpos.{name}" in part.columns for name in places):
            return NEAR if len(part) > 4 * NEAR else 0
    return 0


def _pace(part: Log, settings: Windows) -> float:
    """Return in what time the commands turn back twice [s], the busiest of them.

    Where they do so every ten seconds, windows of three say little: friction holds a joint where
    it is put, and where it comes to rest with and against its load is seen in none of them.
    """
    commands = [part.column(f"ctrl.{name}") for name in part.actuators]
    size, seconds = settings.turn, float(part.time[-1] - part.time[0])
    turns = [reversals(c, size * float(np.ptp(c))) for c in commands if np.ptp(c) > 0]
    return min(2 * seconds / (max(turns, default=0) + 1), settings.slowest_s)


def _anew(part: Log, cuts: np.ndarray, settings: Windows) -> np.ndarray:
    """Return cuts, and one where a loop has hunted and is at rest again, after its warm-up.

    Cuts that such a one would leave too short a window give way to it.
    """
    hunts = is_flagged(part, HUNTING)
    ended = part.time[1:][np.diff(hunts.astype(int)) < 0] + settings.shortest_s + settings.warm_s
    rows = np.searchsorted(part.time, ended[ended < part.time[-1]] - ROUNDING)
    near = np.abs(part.time[cuts[1:-1], None] - part.time[rows]) < settings.shortest_s
    return np.unique([cuts[0], *cuts[1:-1][~near.any(axis=1)], *rows, cuts[-1]])


def _calm_rows(part: Log, first: int, last: int, settings: Windows) -> int:
    """Return after how many rows a loop begins to hunt: all of them where none does, else 0.

    What the robot does afterwards hangs on the phase in which hunting stops, which no start tells.
    """
    before = int(np.searchsorted(part.time, part.time[first] - settings.shortest_s))
    hunts = np.flatnonzero(is_flagged(part, HUNTING)[before:last]) + before
    return last - first if not hunts.size else max(int(hunts[0]) - first, 0)


def reversals(values: np.ndarray, size: float) -> int:
    """How often a signal turns back by more than a size."""
    count, direction, edge = 0, 0, float(values[0])
    for value in values.tolist():
        if (direction >= 0 and value > edge) or (direction <= 0 and value < edge):
            direction = direction or (1 if value > edge else -1 if value < edge else 0)
            edge = value
        elif direction and abs(value - edge) > size:
            count, direction, edge = count + 1, -direction, value
    return count


def _even(part: Log, pieces: int) -> np.ndarray:
    return np.unique(np.linspace(0, len(part), pieces + 1).astype(int))


def _cuts(part: Log, joints: Sequence[Joint], pieces: int, settings: Windows) -> np.ndarray:
    """Return the rows at which windows begin, about evenly and at little motion, and the end."""
    time = part.time
    moving = [(part.column(f"qpos.{joint.name}"), joint.spread) for joint in joints]
    commands = [part.column(f"ctrl.{name}") for name in part.actuators]
    moving += [(command, float(command.std())) for command in commands]
    rates = [np.abs(np.gradient(one, time)) / max(spread, TINY) for one, spread in moving]
    unrest = np.sum(rates, axis=0)
    for name in part.actuators:  # a row without torque is less calm than any other
        unrest = unrest + unrest.max() * ~powered(part, name)
    rate = (len(time) - 1) / (time[-1] - time[0])
    warm, width = max(1, round(settings.warm_s * rate)), 2 * NEAR + 1
    smooth = np.convolve(unrest, np.ones(width) / width, "same")
    reach = max(1, int(settings.reach * len(part) / pieces))
    cuts = [0]
    for cut in _even(part, pieces)[1:-1]:
        start = np.arange(cut - reach, cut + reach) - warm  # where its warm-up would begin
        start = start[(start > cuts[-1]) & (start + warm + 1 < len(part) - 1)]
        cuts.append(int(start[np.argmin(smooth[start])]) + warm if start.size else int(cut))
    return np.unique([*cuts, len(part)])


def cut_one(
    log: Log,
    number: int,
    which: int,
    model: mujoco.MjModel,
    joints: Sequence[Joint],
    rows: tuple[int, int, int],
    settings: Windows = DEFAULT.windows,
) -> Window:
    """Return the window whose warm-up, comparison and end are at these rows of a log."""
    warm, first, last = rows
    origin, scored = float(log.time[warm]), slice(first, last)
    recording = to_recording(log, model, warm, last)
    stamps = [log.columns.get(f"stamp.{joint.name}", log.time)[scored] for joint in joints]
    measured = np.column_stack([log.column(f"qpos.{joint.name}")[scored] for joint in joints])
    spread = np.array([joint.spread for joint in joints])
    moving = np.abs(np.diff(measured, axis=0)).mean(axis=0) / np.maximum(spread, TINY)
    off = 0.0 if recording.powered is None else float(1 - recording.powered.mean())
    lively = float(np.mean(moving)) / max(float(np.diff(log.time[scored]).mean()), TINY)
    usable = _usable(log, warm, last, settings)[first - warm :]
    place = (number, int(log.episode[first]), which, warm, first, last)
    sample = np.column_stack(stamps) - origin  # (T, M)
    return Window(*place, recording, sample, measured, usable, lively, off)


def _usable(log: Log, first: int, last: int, settings: Windows = DEFAULT.windows) -> np.ndarray:
    """Return which rows say what a replay can know, (T,).

    Not a reading that was missing and held, not the moments after a servo was switched on, and not
    those in which something was in the robot's way.
    """
    time = log.time[first:last]
    good = log.fresh[first:last].copy()
    for name in log.actuators:
        on = powered(log, name)[first:last]
        for moment in time[1:][on[1:] & ~on[:-1]]:
            start, end = moment - BEFORE * settings.kick_s, moment + settings.kick_s
            good &= (time < start) | (time > end)
    free = ~is_flagged(log, BLOCKED)[first:last]
    return free & (good if good.sum() > 1 else True)


def is_driven(model: mujoco.MjModel, qpos: int) -> bool:
    """Return whether a position servo drives the joint at that address."""
    return any(
        is_joint_servo(model, i) and model.jnt_qposadr[model.actuator_trnid[i, 0]] == qpos
        for i in range(model.nactuator)
    )
