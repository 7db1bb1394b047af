"""The trajectory log of a robot, an emulator or a simulation: one row per control step.

    log = Log({"episode": [0, 0], "time": [0, 0.02], "ctrl.hinge": [1, 1], "qpos.hinge": [0, 0.1]})
    write_log("swing.csv", log)                     # and swing.json, if there is metadata
    for log in read_logs("swing.csv"):              # a file, a folder, or a list of both
        log.column("qpos.hinge"), log.model, [part.time for part in log.episodes()]

Columns (SI units):

* Required: `episode` (a number), `time` [s from the episode's start: when the row's command is
  written], `ctrl.<actuator>` (the command sent, after every limit, held until the next row) and
  `qpos.<joint>` (measured just before the command; a free joint has `.0` to `.6`).
* Optional: `qvel.<joint>`, `torque.<actuator>` (0: the servo was switched off), `stamp.<joint>`
  [s: when that joint was read], `current.<actuator>` [A], `voltage.<actuator>` [V],
  `temperature.<actuator>` [°C], `sensor.<name>`, `action.<name>`, `obs.<i>`, `reward` and
  `flag.<name>`.
* Optional, for a joint under impedance control: `kp.<actuator>` [N·m/rad], `kd.<actuator>`
  [N·m·s/rad], `qvel_des.<actuator>` [rad/s] and `torque_ff.<actuator>` [N·m].
* Optional, for an IMU at a site of the model: `gyro.<site>.x` to `.z` [rad/s],
  `accelerometer.<site>.x` to `.z` [m/s²] and `quat.<site>.w` to `.z`.

The rows of an episode are contiguous, and its time increases. Other columns are ignored with a
warning.

Metadata (`robot`, `model`, `settings` and others) are stored in a JSON file of the same name, or in
the Parquet schema; the JSON file takes precedence. Every number in a log is finite. Missing values
and other units of time are repaired by the reader (`hardware.formats.repair`), which reports the
repairs and stores them under `reading` in the metadata. A robot's log is `NAME.csv.part` until it
is complete (`hardware/log_writer.py`); all readers accept the `.part` file of a killed program.
"""

from __future__ import annotations

import json
import logging
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from hardware.errors import LogError, did_you_mean, format_names
from hardware.files import atomic_write
from hardware.formats import csv_file, find, parquet
from hardware.formats.names import ACTUATOR_KINDS, JOINT_KINDS, READING, REQUIRED
from hardware.formats.rates import FRESH
from hardware.formats.registry import known, refuse
from hardware.formats.repair import repair

_logger = logging.getLogger(__name__)
MOTIONS = ("ctrl", "qpos", "qvel")
LARGEST = 1e9  # of these, in any unit that a robot may have


@dataclass(frozen=True)
class Log:
    """A checked trajectory log in memory.

    Args:
        columns: values by name, (T,) each; `episode` becomes int64, everything else float64.
        meta: metadata, of JSON types.
        path: the file that it was read from.

    Raises:
        LogError: a required column is missing, lengths differ, a number is not finite, time does
            not increase, or an episode is split or has fewer than 2 rows.
    """

    columns: Mapping[str, np.ndarray]
    meta: dict[str, Any] = field(default_factory=dict)
    path: Path | None = None

    def __post_init__(self) -> None:
        columns = {name: np.asarray(values, float) for name, values in self.columns.items()}
        place = str(self.path or "the log")
        _check(columns, place, 2 if self.path and csv_file.is_log(self.path) else None)
        columns["episode"] = columns["episode"].astype(np.int64)
        object.__setattr__(self, "columns", columns)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def episode(self) -> np.ndarray:
        """The episode of each row, (T,) int64."""
        return self.columns["episode"]

    @property
    def time(self) -> np.ndarray:
        """Time since the start of the episode [s], (T,)."""
        return self.columns["time"]

    @property
    def fresh(self) -> np.ndarray:
        """Whether all joints were read, for each row, (T,) bool: `flag.fresh`, by default true."""
        return self.columns.get(FRESH, np.ones(len(self))) > 0

    @property
    def actuators(self) -> list[str]:
        """Names of the commanded actuators, in the order of the columns."""
        return [name[5:] for name in self.columns if name.startswith("ctrl.")]

    @property
    def joints(self) -> list[str]:
        """Names of the joints with measured positions, in the order of the columns."""
        return list(dict.fromkeys(_joint(n[5:]) for n in self.columns if n.startswith("qpos.")))

    @property
    def model(self) -> Path | None:
        """Path of the MJCF that the metadata name, relative to the log's folder.

        If it does not exist, a file of the same name next to the log is used.
        """
        name = self.meta.get("model")
        if name is None:
            return None
        folder = self.path.parent if self.path else Path()
        here = folder / Path(name).name
        return here if here.is_file() and not (folder / name).exists() else folder / name

    @property
    def settings(self) -> dict[str, Any]:
        """Servo registers by actuator, by which logs are grouped."""
        return self.meta.get("settings", {})

    def column(self, name: str) -> np.ndarray:
        """Return a column, (T,).

        Raises:
            LogError: the log has no such column.
        """
        if name not in self.columns:
            hint = did_you_mean(name, self.columns)
            place = self.path or "the log"
            raise LogError(
                f"{place} has no column {name!r}{hint}; it has {format_names(self.columns)}"
            )
        return self.columns[name]

    def episodes(self) -> Iterator[Log]:
        """Yield one Log for each episode, in the order of the rows."""
        cuts = np.flatnonzero(np.diff(self.episode)) + 1
        for first, last in pairwise([0, *cuts.tolist(), len(self)]):
            yield self.rows(first, last)

    def rows(self, first: int, last: int) -> Log:
        """Return rows `first` to `last` (exclusive): views, which are not checked again."""
        part = copy(self)
        columns = {name: values[first:last] for name, values in self.columns.items()}
        object.__setattr__(part, "columns", columns)
        return part


def read_log(path: str | Path) -> Log:
    """Read one log: CSV, Parquet, or a format of another tool (`hardware.formats`).

    Raises:
        LogError: the file is missing, is not a log, or violates a rule of `Log`; the message names
            file, row and column.
    """
    path = Path(path).expanduser()
    if not path.exists():
        near = [p.name for p in path.parent.glob("*.*")] if path.parent.is_dir() else []
        raise LogError(f"{path}: no such log{did_you_mean(path.name, near)}")
    format = find(path)
    if format is None:
        raise refuse(path)
    columns, meta = format.read(path)
    line = csv_file.FIRST_LINE if format.read is csv_file.read_log else None
    columns, mended = repair(columns, str(path), line)
    for note in mended:
        _logger.warning("%s: %s", path, note)
    notes = [*meta.get(READING, ()), *mended]
    return Log(columns, {**meta, **({READING: notes} if notes else {})}, path)


def read_logs(source: str | Path | Log | Iterable[str | Path | Log]) -> list[Log]:
    """Read a file, all logs of a folder (sorted by name), a LeRobot data set, or a list of these.

    A folder may contain logs of any format; a log in memory is returned unchanged.

    Raises:
        LogError: there are no logs, or a file violates a rule of `read_log`.
    """
    if isinstance(source, Log):
        return [source]
    if not isinstance(source, str | Path):
        logs = [log for part in source for log in read_logs(part)]
        if not logs:
            raise LogError("an empty list of logs was given; name a file or a folder")
        return logs
    path = Path(source).expanduser()
    if not path.is_dir() or find(path) is not None:
        return [read_log(path)]
    inside = path / "data" if (path / "meta" / "info.json").is_file() else path
    found = inside.rglob("*") if inside != path else inside.iterdir()
    files = sorted(p for p in found if not p.name.startswith(".") and find(p) is not None)
    if not files:
        raise LogError(f"{path}: the folder contains no log; a log is {known()}")
    return [read_log(file) for file in files]


def write_log(path: str | Path, log: Log) -> Path:
    """Write a log as CSV or Parquet, according to its suffix, atomically.

    Metadata of a CSV are written to a JSON file of the same name, those of a Parquet file into its
    schema. The model's path is written relative to the log.

    Raises:
        LogError: the suffix is unknown, or pyarrow is needed and missing.
    """
    path = Path(path)
    if path.suffix == ".parquet":
        parquet.write(path, log.columns, _placed(path, log.meta))
        return path
    if path.suffix != ".csv":
        raise LogError(f"{path}: expected a name that ends in .csv or .parquet")
    with atomic_write(path) as temporary:
        csv_file.write(temporary, log.columns)
        write_meta(path, log.meta)
    return path


def write_meta(path: Path, meta: Mapping[str, Any]) -> None:
    """Write the JSON file of a CSV log atomically; without metadata remove it."""
    sidecar = path.with_suffix(".json")
    if not meta:
        return sidecar.unlink(missing_ok=True)
    with atomic_write(sidecar) as text:
        words = json.dumps(_placed(path, meta), indent=1, ensure_ascii=False)
        text.write_text(words + "\n", encoding="utf-8")


def _placed(path: Path, meta: Mapping[str, Any]) -> dict[str, Any]:
    """Return metadata with the model's path as seen from the log."""
    if not Path(meta.get("model", "")).is_absolute():
        return dict(meta)
    return {**meta, "model": os.path.relpath(meta["model"], path.parent.resolve())}


def check_names(
    log: Log, joints: Sequence[str], actuators: Sequence[str], driven: Iterable[str] = ()
) -> None:
    """Refuse a log that names what the model lacks, or lacks a joint that an actuator drives.

    Args:
        log: the log.
        joints: the model's joints.
        actuators: the model's actuators.
        driven: the joints that the logged actuators drive; each needs its `qpos`.

    Raises:
        LogError: with the column, the model's names and the nearest of them.
    """
    place = log.path or "the log"
    for column in log.columns:
        kind, _, name = column.partition(".")
        allowed = joints if kind in JOINT_KINDS else actuators if kind in ACTUATOR_KINDS else None
        if allowed is not None and name not in allowed and _joint(name) not in allowed:
            what = "joint" if kind in JOINT_KINDS else "actuator"
            raise LogError(
                f"{place}, column {column!r}: the model has no {what} {name!r}"
                f"{did_you_mean(name, allowed)}; it has {format_names(allowed)}"
            )
    missing = [name for name in driven if name not in log.joints]
    if missing:
        raise LogError(
            f"{place}: the column 'qpos.{missing[0]}' is missing; an actuator drives that joint"
        )


def _joint(name: str) -> str:
    """The joint of `root.3` is `root`: the fourth number of a free joint."""
    stem, _, index = name.rpartition(".")
    return stem if stem and index.isdigit() else name


def _check(columns: dict[str, np.ndarray], place: str, first_line: int | None) -> None:
    """Raise LogError for whatever a log must not be; `first_line` is the file's line of row 0."""

    def at(row: int, column: str) -> str:
        line = "" if first_line is None else f" (line {row + first_line})"
        return f"{place}, row {row}{line}, column {column!r}"

    _check_columns(columns, place)
    lengths = {name: values.shape for name, values in columns.items()}
    if any(shape != lengths["time"] or len(shape) != 1 for shape in lengths.values()):
        raise LogError(
            f"{place}: every column has one dimension and the same length, not {lengths}"
        )
    for name, values in columns.items():
        most = LARGEST if name.partition(".")[0] in MOTIONS else sys.float_info.max
        if np.abs(values).max(initial=0.0) <= most:
            continue
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            value = values[bad[0]]
            raise LogError(f"{at(bad[0], name)}: {value} is not finite; remove or repair the row")
        bad = np.flatnonzero(np.abs(values) > LARGEST)
        raise LogError(
            f"{at(bad[0], name)}: {values[bad[0]]:g} is not a position, speed or command of a "
            "robot; remove or repair the row"
        )
    episode, time = columns["episode"], columns["time"]
    bad = np.flatnonzero(episode != np.round(episode))
    if bad.size:
        raise LogError(f"{at(bad[0], 'episode')}: {episode[bad[0]]:g} is not a whole number")
    same = np.diff(episode) == 0
    bad = np.flatnonzero(same & (np.diff(time) <= 0)) + 1
    if bad.size:
        before, now = time[bad[0] - 1], time[bad[0]]
        word, fix = "repeats", "remove the row, or stamp rows with more digits"
        if now < before:
            word, fix = "runs back", "give the rows of another recording another `episode`"
        raise LogError(
            f"{at(bad[0], 'time')}: time {word}, {now:.9g} s after {before:.9g} s in one episode; "
            f"{fix}"
        )
    _check_episodes(episode, same, place, at)


def _check_columns(columns: dict[str, np.ndarray], place: str) -> None:
    lacking = [repr(name) for name in REQUIRED if name not in columns]
    hints = "".join(did_you_mean(name, columns) for name in REQUIRED if name not in columns)
    for kind, what in (("ctrl", "actuator"), ("qpos", "joint")):
        if not any(name.startswith(f"{kind}.") for name in columns):
            lacking.append(f"'{kind}.<{what}>'")
    if lacking:
        what = "the column" if len(lacking) == 1 else "the columns"
        verb = "is" if len(lacking) == 1 else "are"
        raise LogError(
            f"{place}: {what} {' and '.join(lacking)} {verb} missing{hints}; it has "
            f"{format_names(columns)}. If they have other names, `sim2real convert LOG "
            "columns=columns.yaml` writes a mapping to check (docs/how-to/prepare_logs.md)"
        )


def _check_episodes(episode: np.ndarray, same: np.ndarray, place: str, at: Any) -> None:
    starts = np.concatenate([[0], np.flatnonzero(~same) + 1]) if len(episode) else np.zeros(0, int)
    if not starts.size:
        raise LogError(f"{place}: the log has no rows; an episode has at least 2")
    sizes = np.diff(np.append(starts, len(episode)))
    if sizes.min() < 2:
        row = starts[int(np.argmin(sizes))]
        name = f"{episode[row]:g}"
        raise LogError(f"{at(row, 'episode')}: episode {name} has 1 row; an episode has at least 2")
    _, first = np.unique(episode[starts], return_index=True)
    again = np.setdiff1d(np.arange(len(starts)), first)
    if again.size:
        row = starts[again[0]]
        raise LogError(
            f"{at(row, 'episode')}: episode {episode[row]:g} occurs again after another; keep its "
            f"rows together, or renumber it"
        )
