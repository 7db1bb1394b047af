"""Repairs that a reader makes in a log, each with a note.

    columns, notes = repair(columns, "run.csv", line=2)

A position that is missing, or that no servo can have had, gets a number between its neighbours, so
that every number is finite, and its row `flag.fresh` = 0, so that no comparison counts it. A
command that is missing is not guessed. Each note is a sentence for the log's reader; they
lie under `reading` in its metadata.

* Time is counted in seconds: rows that are 1 or more apart are not seconds but milliseconds,
  microseconds or nanoseconds. An episode that begins more than 1 s from 0 is of another clock, and
  counted from its start.
* Lost answers are cells without a number; a constant that a reading jumps to and back from (0 or
  2³² while the bus was silent); a reading that stands still while the joint moves on, and jumps.
  A jump is faster than `FASTEST` and than `SUDDEN` times the usual change from row to row.
* Rows without a column `episode` are one episode.
* Angles that come in at the other end of a turn are made continuous.
* Columns that arrive at different rates become rows of a log (`hardware.formats.rates`).
"""

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np

from hardware.errors import LogError, did_you_mean
from hardware.formats.names import INTEGER_KINDS, REQUIRED
from hardware.formats.rates import COMMANDS, FRESH, Columns, align, episodes, of_several_rates

FINE = 1e-9  # s: moments that are less apart are one
SLOWEST = 1.0  # s between two rows of a robot's log; units are a thousand apart
UNITS = ("seconds", "milliseconds", "microseconds", "nanoseconds")
FASTEST = 15.0  # rad/s or m/s: joints of servo robots are slower
SUDDEN = 10.0  # times the median change from row to row
LONGEST = 25  # rows that a lost reading stays at one value
FROZEN = 3  # rows at least that a reading stands still before it is called lost
CATCH_UP = 3.0  # times the way that a joint would have gone on, that it jumps at most
WRAP = 0.9  # of a turn: a change by more is one from end to end
SLACK = 0.2  # rad that a wrapped angle may lie beyond ±π or 0 and 2π


def repair(columns: Mapping[str, np.ndarray], place: str, line: int | None) -> tuple[Columns, list]:
    """Return a log's columns, (T,) each, as they are used, and what was repaired.

    Args:
        columns: as they stand in the file; NaN where a cell is empty.
        place: the file.
        line: the file's line of row 0, if it has lines.

    Raises:
        LogError: a command or a time that is missing, or a column without a number; the message
            says row and column, and what to do.
    """
    columns, notes = dict(columns), list[str]()
    if "time" in columns and "episode" not in columns and not did_you_mean("episode", columns):
        columns["episode"] = np.zeros(len(columns["time"]))
        notes.append("no column `episode`: all rows are one episode")
    if not set(REQUIRED) <= set(columns) or not len(columns["time"]):
        return columns, notes
    _check_numbers(columns, place, line)
    for name in [n for n in columns if n.startswith("qpos.")]:
        notes += _unwrap(columns, name, episodes(columns["episode"]))
    if of_several_rates(columns):
        columns, told = align(columns, place, line)
        notes += told
    _check_commands(columns, place, line)
    parts = episodes(columns["episode"])
    notes += _count_time(columns, parts)
    lost = _fill(columns, parts, place)
    notes += [f"{_lost(name, rows)} missing" for name, rows in lost.items()]
    for name in [n for n in columns if n.startswith("qpos.")]:
        for rows, what in _impossible(columns[name], columns["time"], parts):
            since = columns["time"][rows][0], columns["episode"][rows][0]
            notes.append(
                f"{_lost(name, rows)} {what}, from {since[0]:.4g} s of episode {since[1]:g}"
            )
            columns[name] = _between(columns[name], rows, columns["time"], parts)
            lost[name] = lost.get(name, np.zeros(len(rows), bool)) | rows
    positions = [rows for name, rows in lost.items() if name.startswith("qpos.")]
    if positions:
        fresh = columns.get(FRESH, np.ones(len(columns["time"])))
        columns[FRESH] = np.where(np.any(positions, axis=0), 0.0, fresh)
        left, rows = int(np.sum(columns[FRESH] <= 0)), len(fresh)
        notes.append(f"{left} of {rows} rows are left out of comparisons ({FRESH} = 0)")
    return columns, notes


def _lost(name: str, rows: np.ndarray) -> str:
    count = int(rows.sum())
    return f"{name}: {count} reading{'s' if count > 1 else ''} {'are' if count > 1 else 'is'}"


def _check_numbers(columns: Columns, place: str, line: int | None) -> None:
    """Refuse a column without a number, and a row without its episode or time."""
    for name, values in columns.items():
        bad = np.flatnonzero(np.isnan(values))
        if bad.size == len(values):
            raise LogError(
                f"{place}, column {name!r}: no number in it; log it, or remove the column"
            )
        if bad.size and name in REQUIRED:
            raise _missing(f"the {name}", name, int(bad[0]), place, line)


def _check_commands(columns: Columns, place: str, line: int | None) -> None:
    """Refuse a command that is missing among others: it cannot be guessed."""
    for name, values in columns.items():
        bad = np.flatnonzero(np.isnan(values))
        if bad.size and name.partition(".")[0] in COMMANDS:
            raise _missing("a command", name, int(bad[0]), place, line)


def _missing(what: str, name: str, row: int, place: str, line: int | None) -> LogError:
    at = f"row {row}" + ("" if line is None else f" (line {row + line})")
    return LogError(
        f"{place}, {at}, column {name!r}: {what} is missing, which is not guessed; write it, or "
        "remove the row"
    )


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


def _fill(columns: Columns, parts: list[slice], place: str) -> dict[str, np.ndarray]:
    """Give readings that are missing a number; return where they are, by column."""
    lost = {name: gone for name, v in columns.items() if (gone := np.isnan(v)).any()}
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
    if not _wraps(columns[name], parts):
        return []
    command = f"ctrl.{name.partition('.')[2]}"
    for one in (name, command):
        if one in columns and _wraps(columns[one], parts, least=0):
            values = columns[one].copy()
            for part in parts:
                there = part.start + np.flatnonzero(np.isfinite(values[part]))
                values[there] = np.unwrap(values[there])
            columns[one] = values
    return [f"{name}: the angle is wrapped to one turn and was made continuous"]


def _wraps(q: np.ndarray, parts: list[slice], least: int = 1) -> bool:
    """Return whether an angle stays within a turn, and leaves it at one end for the other."""
    read = [q[part][np.isfinite(q[part])] for part in parts]
    turns = sum(int((np.abs(np.diff(one)) > WRAP * 2 * math.pi).sum()) for one in read)
    low, high = float(np.nanmin(q)), float(np.nanmax(q))
    centred = -math.pi - SLACK <= low and high <= math.pi + SLACK
    return turns >= least and (centred or (low >= -SLACK and high <= 2 * math.pi + SLACK))
