"""Logs of a robot arm as SAGE writes them: a folder with `control.csv` and `state_motor.csv`.

    columns, meta = read(Path("custom/friction_gravity"))

Each row of both files has a `timestamp` [µs] and lists with a number for every joint: `positions`
[rad] in both, `velocities` and `torques` in the state. Whole-numbered velocities are counts of a
4096-count encoder a second, as a Feetech servo reports them, others rad/s. `torques` become
`sensor.current_raw_<joint>`: on such servos they are the current or a multiple of it, without its
sign.

The joints' names come from `joint_list.txt` in the folder or in one of the two above it. A file
`log.json` in the same places can say more: `{"joints": [..]}` gives other names (those of a
model), `{"model": "arm.xml"}` the MJCF, and `{"scale": {"gripper": [-0.1745, 1.9198]}}` offset and
factor that turn a joint's numbers into rad.
"""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hardware.errors import LogError, format_names
from hardware.formats.names import READING
from hardware.formats.rates import align, merge

FILES = ("control.csv", "state_motor.csv")
MICRO = 1e-6  # s
COUNT = 2 * np.pi / 4096  # rad
ABOVE = 3  # folders in which names are looked for: the log's own and two above


def is_log(path: Path) -> bool:
    """Say whether a folder is such a log."""
    return all((path / name).is_file() for name in FILES)


def read(folder: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the columns of the log, (T,) each, and its metadata.

    Raises:
        LogError: a file is damaged; the message says file, row, line and column.
    """
    sent, state = (_table(folder / name) for name in FILES)
    meta = _meta(folder)
    joints = _joints(folder, meta, sent["positions"].shape[1])
    scale = {name: meta.get("scale", {}).get(name, (0.0, 1.0)) for name in joints}
    series = {}
    for kind, table in (("ctrl", sent), ("qpos", state)):
        for i, name in enumerate(joints):
            offset, factor = scale[name]
            series[f"{kind}.{name}"] = (
                table["timestamp"],
                offset + factor * table["positions"][:, i],
            )
    more = _more(state, joints, {name: pair[1] for name, pair in scale.items()})
    series |= {name: (state["timestamp"], values) for name, values in more.items()}
    if sent["timestamp"][-1] < state["timestamp"][0]:
        raise LogError(f"{folder}: every command was sent before the first state was read")
    columns, notes = align(merge(series), str(folder))
    start = columns["time"][0]
    for name in columns:
        if name == "time" or name.startswith("stamp."):
            columns[name] = MICRO * (columns[name] - start)
    meta = {key: value for key, value in meta.items() if key not in ("joints", "scale")}
    return columns, {READING: notes, **meta}


def _more(
    state: dict[str, np.ndarray], joints: Sequence[str], factors: dict[str, float]
) -> dict[str, np.ndarray]:
    """Speeds and currents by the name of the column."""
    columns = {}
    if "velocities" in state:
        raw = state["velocities"]
        speeds = raw * (COUNT if np.array_equal(raw, np.round(raw)) else 1.0)
        columns |= {f"qvel.{n}": factors[n] * speeds[:, i] for i, n in enumerate(joints)}
    if "torques" in state:
        raw = state["torques"]
        columns |= {f"sensor.current_raw_{n}": raw[:, i] for i, n in enumerate(joints)}
    return columns


def _table(path: Path) -> dict[str, np.ndarray]:
    """Return `timestamp` (T,) and the lists (T, joints) of one file."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        rows = list(csv.DictReader(file))
    if not rows or "timestamp" not in rows[0] or "positions" not in rows[0]:
        has = format_names(rows[0]) if rows else "no rows"
        raise LogError(f"{path}: the columns 'timestamp' and 'positions' are missing; it has {has}")
    lists = [name for name in ("positions", "velocities", "torques") if name in rows[0]]
    stamps = np.array([_cell(path, i, r["timestamp"], "timestamp") for i, r in enumerate(rows)])
    table = {
        name: [_cell(path, row, r[name], name) for row, r in enumerate(rows)] for name in lists
    }
    width = np.size(table["positions"][0])
    for name, values in table.items():
        for row, value in enumerate(values):
            if np.shape(value) != (width,):
                raise LogError(
                    f"{path}, row {row} (line {row + 2}), column {name!r}: {np.size(value)} "
                    f"numbers, but the first row has {width}"
                )
    back = np.flatnonzero(np.diff(stamps) <= 0)
    if back.size:
        row = int(back[0]) + 1
        raise LogError(
            f"{path}, row {row} (line {row + 2}), column 'timestamp': time runs back or repeats, "
            f"{stamps[row]:.9g} after {stamps[row - 1]:.9g}"
        )
    return {"timestamp": stamps, **{name: np.array(values) for name, values in table.items()}}


def _cell(path: Path, row: int, text: str | None, column: str) -> Any:
    """A number, or a list of numbers as an array."""
    try:
        value = np.asarray(json.loads(text or ""), float)
        if value.ndim != (column != "timestamp"):
            raise ValueError
    except (TypeError, ValueError):
        what = "a number" if column == "timestamp" else "a list of numbers"
        place = f"{path}, row {row} (line {row + 2}), column {column!r}"
        raise LogError(f"{place}: {text!r} is not {what}") from None
    return float(value) if column == "timestamp" else value


def _meta(folder: Path) -> dict[str, Any]:
    """The content of log.json, with an absolute path of the model."""
    meta: dict[str, Any] = {}
    for place in _places(folder):
        path = place / "log.json"
        if path.is_file():
            try:
                meta = json.loads(path.read_text(encoding="utf-8"))
            except ValueError as error:
                raise LogError(f"{path}: cannot be read as JSON: {error}") from None
            if not isinstance(meta, dict):
                raise LogError(f"{path}: expected a table of names and values")
            if "model" in meta:
                meta["model"] = str((place / str(meta["model"])).resolve())
            break
    return {"source": "sage", "motion": folder.name, **meta}


def _joints(folder: Path, meta: dict[str, Any], count: int) -> list[str]:
    """The joints' names: from log.json, else from joint_list.txt, else numbered."""
    names, source = meta.get("joints"), "log.json"
    for place in _places(folder):
        path = place / "joint_list.txt"
        if names is None and path.is_file():
            words = path.read_text(encoding="utf-8").split("\n")
            names, source = [word.strip() for word in words if word.strip()], str(path)
    names = [f"joint{i}" for i in range(count)] if names is None else [str(n) for n in names]
    if len(names) != count or len(set(names)) != count:
        raise LogError(
            f"{folder}: {source} must name {count} different joints, one for each number of a "
            f"position; it has {format_names(names)}"
        )
    return names


def _places(folder: Path) -> list[Path]:
    return [folder, *folder.resolve().parents][:ABOVE]
