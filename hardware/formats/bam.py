"""Logs of a servo on a pendulum bench as Rhoban's BAM writes them: one JSON file a run.

    columns, meta = read(Path("2026-01-15_10h28m10.json"))

The file is a table with `entries`, each with `position` [rad], `goal_position` [rad],
`torque_enable` and `timestamp` [s] (or one `dt` [s] for all), and mostly `speed` [rad/s],
`input_volts` [V], `temp` [°C] and `load` (the servo's own number: for Dynamixel X the PWM register,
885 at full duty, two's complement of 16 bits). Joint and actuator are called `hinge`. The
conditions become the metadata `settings`, `mass_kg`, `length_m` and `nominal_voltage`.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hardware.errors import LogError, did_you_mean, format_names

NAME = "hinge"
REQUIRED = {"goal_position": f"ctrl.{NAME}", "position": f"qpos.{NAME}"}
OPTIONAL = {
    "speed": f"qvel.{NAME}",
    "torque_enable": f"torque.{NAME}",
    "load": "sensor.pwm",
    "input_volts": f"voltage.{NAME}",
    "temp": f"temperature.{NAME}",
}
CONDITIONS = {"mass": "mass_kg", "length": "length_m", "vin": "nominal_voltage"}
WRAP = 2**16  # of a register of two bytes
HEAD = 4096  # characters in which `entries` comes up


def is_log(path: Path) -> bool:
    """Say whether a JSON file is such a log, from its first characters."""
    try:
        with path.open(encoding="utf-8") as file:
            return path.suffix == ".json" and '"entries"' in file.read(HEAD)
    except (OSError, UnicodeDecodeError):
        return False


def read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the columns of the file, (T,) each, and what it says of the conditions.

    Raises:
        LogError: no such table, or an entry that lacks a number; the message says where.
    """
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise LogError(f"{path}: cannot be read as JSON: {error}") from None
    entries = table.get("entries") if isinstance(table, dict) else None
    if not isinstance(entries, list) or not entries:
        raise LogError(f"{path}: a BAM log is a table with a list 'entries'; this has none")
    columns = {"episode": np.zeros(len(entries)), "time": _time(path, table, entries)}
    for key, column in REQUIRED.items():
        columns[column] = _numbers(path, entries, key)
    for key, column in OPTIONAL.items():
        if key in entries[0]:
            columns[column] = _numbers(path, entries, key)
    load = columns.get(OPTIONAL["load"])
    if load is not None:
        load[load >= WRAP / 2] -= WRAP
    return columns, _conditions(table)


def _time(path: Path, table: Mapping[str, Any], entries: list[Any]) -> np.ndarray:
    """Seconds from the first entry, (T,)."""
    if isinstance(entries[0], dict) and "timestamp" not in entries[0] and "dt" in table:
        return np.arange(len(entries)) * float(table["dt"])
    stamps = _numbers(path, entries, "timestamp")
    return stamps - stamps[0]


def _numbers(path: Path, entries: list[Any], key: str) -> np.ndarray:
    """One key of all entries, (T,)."""
    values = np.empty(len(entries))
    for row, entry in enumerate(entries):
        place = f"{path}, row {row}"
        if not isinstance(entry, dict):
            raise LogError(f"{place}: the entry is a {type(entry).__name__}, not a table")
        if key not in entry:
            hint = did_you_mean(key, entry)
            raise LogError(f"{place}: the entry has no {key!r}{hint}; it has {format_names(entry)}")
        try:
            values[row] = float(entry[key])
        except (TypeError, ValueError):
            raise LogError(f"{place}, column {key!r}: {entry[key]!r} is not a number") from None
    return values


def _conditions(table: Mapping[str, Any]) -> dict[str, Any]:
    meta: dict[str, Any] = {"source": "bam"}
    if "motor" in table:
        meta["robot"] = f"{table['motor']}_bench"
    if "kp" in table:
        meta["settings"] = {NAME: {"position_p_gain": table["kp"]}}
    if "trajectory" in table:
        meta["trajectory"] = table["trajectory"]
    return meta | {name: table[key] for key, name in CONDITIONS.items() if key in table}
