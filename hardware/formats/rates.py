"""Tables whose columns arrive at different rates, as a log has them: a row for each command.

    columns = merge({"ctrl.a": (sent, goals), "qpos.a": (read, angles)})     # NaN: no message
    if of_several_rates(columns):
        columns, notes = align(columns, "run.csv", line=2)

Recordings of several channels in one table (a rosbag's or PlotJuggler's CSV, `pandas.merge`) have
a row for each message and empty cells in the columns of all others. Of two channels the slower one
is missing in half of the rows or more, whatever their rates are: so lost readings are told apart.

* A row is a command, or a reading of which another follows before the next command.
* Commands hold their last value, as servos do. What is neither command nor position nor speed is
  the latest before the row.
* A reading is whole when every joint was read since the one before. It stands in the first row from
  then on, and `stamp.<joint>` says when it was read; a speed is that of the joint's stamp.
* A row without a new reading has `flag.fresh` = 0, and positions between their neighbours.
* Rows before each command and position came for the first time are left out.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from hardware.errors import LogError

Columns = dict[str, np.ndarray]
SHARE = 0.4  # of the rows without a command or position: half, less what may be lost of the faster
COMMANDS = ("ctrl", "torque", "kp", "kd", "qvel_des", "torque_ff")
NAMED = 3  # columns that a note lists
FRESH = "flag.fresh"


class Series(NamedTuple):
    """One channel on its own clock; its moments increase."""

    time: np.ndarray  # (n,)
    value: np.ndarray  # (n,)


def merge(series: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> Columns:
    """Return channels, each of moments (n,) and values (n,), as one table; NaN: no message."""
    time = np.unique(np.concatenate([time for time, _ in series.values()]))
    columns = {"episode": np.zeros(len(time)), "time": time}
    for name, (own, values) in series.items():
        columns[name] = np.full(len(time), np.nan)
        columns[name][np.searchsorted(time, own)] = values
    return columns


def of_several_rates(columns: Mapping[str, np.ndarray]) -> bool:
    """Return whether a command or a position is missing in so many rows that it has its own."""
    return any(
        SHARE <= float(np.isnan(values).mean()) < 1.0
        for name, values in columns.items()
        if name.startswith(("ctrl.", "qpos."))
    )


def episodes(episode: np.ndarray) -> list[slice]:
    """Return the rows of each episode, from its numbers (T,)."""
    cuts = np.flatnonzero(np.diff(episode) != 0) + 1
    return [slice(a, b) for a, b in pairwise([0, *cuts.tolist(), len(episode)])]


def align(
    columns: Mapping[str, np.ndarray], place: str, line: int | None = None
) -> tuple[Columns, list[str]]:
    """Return a table of messages with rows of a log, (T,) each, and what was done in sentences.

    Args:
        columns: with `episode` and `time` in every row, in any unit; NaN where nothing came.
        place: the file.
        line: the file's line of row 0, if it has lines.

    Raises:
        LogError: an episode lacks a command or position, or has too few; a column's time runs back.
    """
    notes = [_told(columns)]
    parts, late = [], {}
    for rows in episodes(columns["episode"]):
        part = {name: values[rows] for name, values in columns.items()}
        channels = _channels(part, place, rows.start, line)
        parts.append(_aligned(part, channels, place))
        names = [n for n in channels if _is_needed(n)]
        last = max(names, key=lambda name: channels[name].time[0])
        missed = int(np.sum(part["time"] < channels[last].time[0]))
        late[last] = late.get(last, 0) + missed
    made = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    if all(np.array_equal(v, made["time"]) for n, v in made.items() if n.startswith("stamp.")):
        made = {n: v for n, v in made.items() if not n.startswith("stamp.")}
    old = int(np.sum(made[FRESH] <= 0))
    if old:
        notes.append(f"{old} of {len(made['time'])} rows have no new reading ({FRESH} = 0)")
    else:
        del made[FRESH]
    for name, count in late.items():
        if count:
            rows = "1 row before" if count == 1 else f"{count} rows before"
            notes.append(f"{rows} the first {name} {'is' if count == 1 else 'are'} left out")
    return made, notes


def _is_needed(name: str) -> bool:
    """Return whether a simulation cannot start without a column."""
    return name.partition(".")[0] in (*COMMANDS, "qpos")


def _told(columns: Mapping[str, np.ndarray]) -> str:
    """Return at how many moments commands and positions came."""
    groups: dict[int, list[str]] = {}
    for name, values in columns.items():
        if name.startswith(("ctrl.", "qpos.")):
            groups.setdefault(int(np.isfinite(values).sum()), []).append(name)
    each = [
        f"{', '.join(names[:NAMED])}{f' and {len(names) - NAMED} more' * (len(names) > NAMED)} at "
        f"{count}"
        for count, names in groups.items()
    ]
    return (
        f"the columns arrive at moments of their own ({'; '.join(each)} of {len(columns['time'])}):"
        " a command holds its value, and a position stands in the first row after it was read"
    )


def _channels(part: Columns, place: str, start: int, line: int | None) -> dict[str, Series]:
    """Return the channels of an episode by their columns."""
    found = {}
    for name, values in part.items():
        if name in ("episode", "time") or name.startswith("stamp."):
            continue
        there = np.flatnonzero(np.isfinite(values))
        if not there.size:
            raise LogError(
                f"{place}, column {name!r}: episode {part['episode'][0]:g} has no number in it; "
                "remove the episode, or the column"
            )
        clock = part.get(f"stamp.{name.partition('.')[2]}", part["time"])
        time = np.where(np.isnan(clock), part["time"], clock)[there]
        back = np.flatnonzero(np.diff(time) <= 0) + 1
        if back.size:
            row = start + int(there[back[0]])
            at = f"row {row}" + ("" if line is None else f" (line {row + line})")
            word = "repeats" if time[back[0]] == time[back[0] - 1] else "runs back"
            raise LogError(
                f"{place}, {at}, column {name!r}: time {word}, {time[back[0]]:.9g} after "
                f"{time[back[0] - 1]:.9g}; give each recording an `episode`, or remove the row"
            )
        found[name] = Series(time, values[there])
    return found


def _aligned(part: Columns, channels: Mapping[str, Series], place: str) -> Columns:
    """Return an episode's columns with a row for each command, and for each reading between."""
    began = max(one.time[0] for name, one in channels.items() if _is_needed(name))
    joints = [name for name in channels if name.startswith("qpos.")]
    sent = np.unique(
        np.concatenate([c.time for name, c in channels.items() if name.startswith("ctrl.")])
    )
    stamps = _whole_readings([channels[name].time for name in joints])
    read = stamps.max(axis=1)  # (K,) when each is whole
    between = read[:-1][_next(sent, read[:-1]) >= read[1:]]
    after = read[-1:][read[-1:] > sent[-1]]
    time = np.union1d(sent, np.concatenate([between, after]))
    time = time[time >= began]
    if len(time) < 2:
        raise LogError(
            f"{place}: episode {part['episode'][0]:g} has {len(time)} commands and readings after "
            "each column came for the first time; record the channels at once"
        )
    latest = np.searchsorted(read, time, side="right") - 1
    fresh = (latest >= 0) & np.r_[True, np.diff(latest) > 0]
    coming = stamps[np.minimum(latest + ~fresh, len(read) - 1)]  # (T, M)
    moment = np.where(fresh[:, None], coming, np.minimum(time[:, None], coming))
    found = {"episode": np.full(len(time), part["episode"][0]), "time": time}
    of_joint = dict(zip((name[5:] for name in joints), moment.T, strict=True))
    for name, one in channels.items():
        kind, _, joint = name.partition(".")
        if kind in ("qpos", "qvel") and joint in of_joint:
            found[name] = np.interp(of_joint[joint], one.time, one.value)
        else:
            last = np.searchsorted(one.time, time, side="right") - 1
            found[name] = one.value[np.maximum(last, 0)]
    found |= {f"stamp.{joint}": own for joint, own in of_joint.items()}
    found[FRESH] = np.where(fresh, found.get(FRESH, 1.0), 0.0)
    return found


def _next(moments: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return the first of some moments at or after each of others; inf where there is none."""
    return np.append(moments, np.inf)[np.searchsorted(moments, after)]


def _whole_readings(times: Sequence[np.ndarray]) -> np.ndarray:
    """Return when each joint was read, (K, M), of readings in which every joint was read anew.

    Args:
        times: moments at which each joint was read, (n,) increasing.
    """
    if all(np.array_equal(time, times[0]) for time in times[1:]):
        return np.column_stack(times)
    last, found = -np.inf, []
    while True:
        first = [int(np.searchsorted(time, last, side="right")) for time in times]
        if any(i == len(time) for i, time in zip(first, times, strict=True)):
            return np.array(found).reshape(-1, len(times))
        last = max(time[i] for i, time in zip(first, times, strict=True))
        found.append([time[np.searchsorted(time, last, side="right") - 1] for time in times])
