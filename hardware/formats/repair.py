"""What a reader mends in a log before anybody works with it, and what it says about that.

    columns, notes = repair(columns, "run.csv", line=2)

A position that is missing, or that no servo can have had, gets a number between its neighbours, so
that every number is finite, and its row `flag.fresh` = 0, so that no comparison counts it. A
command that is missing is not guessed. Each note is a sentence for whoever works with the log; they
lie under `reading` in its metadata.

* Time is counted in seconds: rows that are 1 or more apart are no seconds but milliseconds,
  microseconds or nanoseconds. An episode that begins more than 1 s from 0 is of another clock, and
  counted from its start.
* Lost answers are cells without a number; a constant that a reading jumps to and back from (0 or
  2³² while the bus was silent); a reading that stands still while the joint moves on, and jumps.
  A jump is faster than `FASTEST` and than `SUDDEN` times the usual change from row to row.
* Angles that come in at the other end of a turn are made continuous.
"""

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from hardware.errors import LogError
from hardware.formats.names import INTEGER_KINDS, REQUIRED

Columns = dict[str, np.ndarray]
FINE = 1e-9  # s: moments that are less apart are one
SLOWEST = 1.0  # s between two rows of a robot's log; units are a thousand apart
UNITS = ("seconds", "milliseconds", "microseconds", "nanoseconds")
FASTEST = 15.0  # rad/s or m/s: joints of servo robots are slower
SUDDEN = 10.0  # times the median change from row to row
LONGEST = 25  # rows that a lost reading stays at one value
FROZEN = 3  # rows at least that a reading stands still before it is called lost
CATCH_UP = 3.0  # times the way that a joint would have gone on, that it jumps at most
MISSING = 0.5  # share of the rows without a position from which on a log is of another kind
WRAP = 0.9  # of a turn: a change by more is one from end to end
SLACK = 0.2  # rad that a wrapped angle may lie beyond ±π or 0 and 2π
COMMANDS = ("ctrl", "torque", "kp", "kd", "qvel_des", "torque_ff")


def repair(columns: Mapping[str, np.ndarray], place: str, line: int | None) -> tuple[Columns, list]:
    """Return a log's columns, (T,) each, as they are worked with, and what was mended.

    Args:
        columns: as they stand in the file; NaN where a cell is empty.
        place: the file.
        line: the file's line of row 0, if it has lines.

    Raises:
        LogError: a command or a time that is missing, or a column without a number; the message
            says row and column, and what to do.
    """
    columns, notes = dict(columns), []
    if not set(REQUIRED) <= set(columns) or not len(columns["time"]):
        return columns, notes
    _check_required(columns, place, line)
    parts = _episodes(columns["episode"])
    notes += _count_time(columns, parts)
    lost = _fill(columns, parts, place, line)
    notes += [f"{_lost(name, rows)} missing" for name, rows in lost.items()]
    for name in [n for n in columns if n.startswith("qpos.")]:
        notes += _unwrap(columns, name, parts)
        for rows, what in _impossible(columns[name], columns["time"], parts):
            since = columns["time"][rows][0], columns["episode"][rows][0]
            notes.append(
                f"{_lost(name, rows)} {what}, from {since[0]:.4g} s of episode {since[1]:g}"
            )
            columns[name] = _between(columns[name], rows, columns["time"], parts)
            lost[name] = lost.get(name, np.zeros(len(rows), bool)) | rows
    positions = [rows for name, rows in lost.items() if name.startswith("qpos.")]
    if positions:
        fresh = columns.get("flag.fresh", np.ones(len(columns["time"])))
        columns["flag.fresh"] = np.where(np.any(positions, axis=0), 0.0, fresh)
        rows = int(np.any(positions, axis=0).sum())
        notes.append(f"{rows} of {len(fresh)} rows are left out of comparisons (flag.fresh = 0)")
    return columns, notes


def _lost(name: str, rows: np.ndarray) -> str:
    count = int(rows.sum())
    return f"{name}: {count} reading{'s' if count > 1 else ''} {'are' if count > 1 else 'is'}"


def _check_required(columns: Columns, place: str, line: int | None) -> None:
    """Refuse what cannot be guessed: a missing episode, time or command."""
    for name, values in columns.items():
        kind = name.partition(".")[0]
        bad = np.flatnonzero(np.isnan(values))
        if bad.size == len(values):
            raise LogError(
                f"{place}, column {name!r}: there is no number in it; log it, or remove the column"
            )
        if bad.size and (kind in COMMANDS or name in REQUIRED):
            what = "a command" if kind in COMMANDS else f"the {name}"
            row = f"row {bad[0]}" + ("" if line is None else f" (line {bad[0] + line})")
            raise LogError(
                f"{place}, {row}, column {name!r}: {what} is missing, which is not guessed; write "
                "it, or remove the row"
            )


def _episodes(episode: np.ndarray) -> list[slice]:
    """Return the rows of each episode."""
    cuts = np.flatnonzero(np.diff(episode) != 0) + 1
    ends = [0, *cuts.tolist(), len(episode)]
    return [slice(a, b) for a, b in pairwise(ends)]


def _count_time(columns: Columns, parts: list[slice]) -> list[str]:
    """Count time and stamps in seconds, and from the episode's start where another clock did."""
    time = columns["time"]
    steps = np.concatenate([np.diff(time[part]) for part in parts])
    middle = float(np.median(steps)) if steps.size else 0.0
    power = 0
    while power < len(UNITS) - 1 and middle >= SLOWEST * 1000**power:
        power += 1
    clocks = [name for name in columns if name == "time" or name.startswith("stamp.")]
    for name in clocks:
        values = columns[name].copy()
        for part in parts:
            start = float(time[part][0])
            start = start if abs(start) > SLOWEST * 1000**power else 0.0
            values[part] = _from(values[part], start, 1000**power)
        columns[name] = values
    if not power:
        return []
    return [f"time is read as {UNITS[power]}: its rows are {middle:.4g} apart"]


def _from(values: np.ndarray, start: float, unit: int) -> np.ndarray:
    """Return moments in s from a start, (T,), rounded to what numbers so large can tell apart.

    A command acts from its stamp on: 20 ms and 0.1 µs would be one simulation step late.
    """
    apart = 4 * float(np.spacing(max(abs(start), 1.0))) / unit
    found = (values - start) / unit
    return np.round(found, math.floor(-math.log10(apart))) if apart > FINE else found


def _fill(
    columns: Columns, parts: list[slice], place: str, line: int | None
) -> dict[str, np.ndarray]:
    """Give readings that are missing a number; return where they are, by column."""
    lost = {name: gone for name, v in columns.items() if (gone := np.isnan(v)).any()}
    positions = [rows for name, rows in lost.items() if name.startswith("qpos.")]
    share = float(np.any(positions, axis=0).mean()) if positions else 0.0
    if share > MISSING:
        name = next(n for n in lost if n.startswith("qpos."))
        row = int(np.argmax(lost[name]))
        at = f"row {row}" + ("" if line is None else f" (line {row + line})")
        raise LogError(
            f"{place}, {at}, column {name!r}: a position is missing in {share:.0%} of the rows, "
            "here first; if joints were read at different moments, repeat the latest reading and "
            "write when it was read as `stamp.<joint>`"
        )
    for name, rows in lost.items():
        columns[name] = _between(columns[name], rows, columns["time"], parts)
        if name.partition(".")[0] in INTEGER_KINDS:
            columns[name] = np.round(columns[name])
        if np.isnan(columns[name]).any():
            row = int(np.argmax(np.isnan(columns[name])))
            number = columns["episode"][row]
            raise LogError(
                f"{place}, column {name!r}: episode {number:g} has no number in it; remove the "
                "episode, or the column"
            )
    return lost


def _between(
    values: np.ndarray, gone: np.ndarray, time: np.ndarray, parts: list[slice]
) -> np.ndarray:
    """Return a column with numbers between the neighbours where some are gone; within episodes."""
    filled = values.copy()
    for part in parts:
        kept = ~gone[part]
        if kept.any() and not kept.all():
            filled[part] = np.interp(time[part], time[part][kept], values[part][kept])
    return filled


def _impossible(
    values: np.ndarray, time: np.ndarray, parts: list[slice]
) -> Iterator[tuple[np.ndarray, str]]:
    """Yield rows that no servo can have read, (T,) bool, with what they do."""
    away, frozen = np.zeros(len(values), bool), np.zeros(len(values), bool)
    for part in parts:
        q, t = values[part], time[part]
        if len(q) <= FROZEN:
            continue
        change = np.diff(q)
        least = np.maximum(FASTEST * np.diff(t), SUDDEN * float(np.median(np.abs(change))))
        jump = np.abs(change) > least
        for first, last in _runs(q) if jump.any() else ():
            before, after = first - 1, last - 1  # changes into and out of a run
            comes, goes = before >= 0 and jump[before], last < len(q) and jump[after]
            if last - first > LONGEST or not (comes or goes):
                continue
            at_end = first == 0 or last == len(q)
            if (comes or first == 0) and (goes or last == len(q)):
                if at_end or change[before] * change[after] < 0:
                    away[part.start + first : part.start + last] = True
            elif goes and last - first >= FROZEN and _moves_on(change, before, after):
                frozen[part.start + first + 1 : part.start + last] = True
    if away.any():
        yield away, "constant where it jumps away and back"
    if frozen.any():
        yield frozen, "frozen while the joint moves on"


def _runs(q: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield first and last (exclusive) row of each stretch of one value."""
    ends = [0, *(np.flatnonzero(np.diff(q)) + 1).tolist(), len(q)]
    yield from pairwise(ends)


def _moves_on(change: np.ndarray, before: int, after: int) -> bool:
    """Return whether a joint moved before it stood still, and a jump makes up for that.

    Args:
        change: from row to row.
        before: place of the last change before it stood still.
        after: place of the jump.
    """
    way = (after - before + 1) * change[before]
    return bool(change[after] * change[before] > 0 and abs(change[after]) < CATCH_UP * abs(way))


def _unwrap(columns: Columns, name: str, parts: list[slice]) -> list[str]:
    """Make an angle continuous that comes in at the other end of a turn, and its command."""
    q = columns[name]
    if not _wraps(q, parts):
        return []
    command = f"ctrl.{name.partition('.')[2]}"
    for one in (name, command):
        if one in columns and _wraps(columns[one], parts, least=0):
            values = columns[one].copy()
            for part in parts:
                values[part] = np.unwrap(values[part])
            columns[one] = values
    return [f"{name}: the angle is wrapped to one turn and was made continuous"]


def _wraps(q: np.ndarray, parts: list[slice], least: int = 1) -> bool:
    """Return whether an angle stays within a turn, and leaves it at one end for the other."""
    turns = sum(int((np.abs(np.diff(q[part])) > WRAP * 2 * math.pi).sum()) for part in parts)
    low, high = float(q.min()), float(q.max())
    centred = -math.pi - SLACK <= low and high <= math.pi + SLACK
    return turns >= least and (centred or (low >= -SLACK and high <= 2 * math.pi + SLACK))
