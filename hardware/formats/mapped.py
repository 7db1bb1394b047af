"""Logs under other names, in CSV, Parquet, HDF5 or Zarr: a `columns.yaml` says what is what.

    # columns.yaml, next to the log (or NAME.columns.yaml for one log)
    columns:
      time:       {from: t_ms, unit: ms}
      ctrl.elbow: {from: cmd_elbow, unit: deg}
      qpos.elbow: {from: pos_elbow, unit: deg, scale: -1, offset: 0.1}   # offset in SI, after scale
      qvel.elbow: {from: /obs/qvel, index: 1}                            # HDF5, Zarr: array, column
      qpos.wrist: {from: raw_3, unit: counts/4096, zero: 2048}           # zero in the source's unit
      qpos.hip:   {from: raw_4, unit: counts}                            # as the robot's file says
    episodes: /data/demo_*          # HDF5, Zarr: one episode a group, names below are within it
    rate: 50                        # Hz, where there is no time
    meta: {model: arm.xml, robot: arm2}

Without `episode` all rows are one episode, which starts at 0 s. `time: {from: sec, nanosec: nsec}`
adds the nanoseconds of a ROS stamp. A CSV without a line of names has the numbers of its columns as
names (`from: 0`); of two such lines the names are joined with a space. `hardware.formats.guess`
writes such a file from a header, for a person to read over. HDF5 needs h5py and Zarr zarr (the
extra `data`).
"""

import csv
import fnmatch
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hardware.config import load_robot
from hardware.errors import LogError, did_you_mean, format_names
from hardware.formats import parquet
from hardware.formats.cells import NANO, is_value, labels, numbers, seconds
from hardware.formats.csv_file import separator_of
from hardware.formats.names import SOURCE_UNITS, check_sources, known
from hardware.formats.sidecar import read_meta
from hardware.formats.units import COUNTS, factor

NAME = "columns.yaml"
ARRAYS = (".h5", ".hdf5", ".zarr")
TABLES = (".csv", ".parquet")
ENTRY = ("from", "index", "unit", "zero", "scale", "offset", "nanosec")
KEYS = ("columns", "episodes", "rate", "meta")
TAKEN = ("from", "nanosec")  # keys of an entry that name a source
REGISTER = "counts"  # unit: the robot's file says how many in a turn, and where the zero is
SIGNED = (16, 32)  # bits of registers whose negative numbers are read as large ones
HEADERS = 2  # lines of names at most


def mapping_file(path: Path) -> Path | None:
    """Return the columns.yaml that goes with a log: its own, or its folder's."""
    places = (path.with_name(f"{path.stem}.{NAME}"), path.parent / NAME)
    return next((place for place in places if place.is_file()), None)


def is_log(path: Path) -> bool:
    """Say whether a path is a table or a file of arrays with a columns.yaml."""
    return path.suffix.lower() in (*TABLES, *ARRAYS) and mapping_file(path) is not None


def read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the columns that the mapping names, (T,) each, in SI units.

    Raises:
        LogError: the mapping or the file is wrong; the message names file, column and source.
    """
    file = mapping_file(path)
    assert file is not None
    mapping = _mapping(file)
    parts = []
    for number, source in enumerate(_episodes(path, mapping)):
        columns = {
            name: _column(path, file, name, entry, source)
            for name, entry in mapping["columns"].items()
        }
        parts.append(_completed(path, file, columns, mapping.get("rate"), number))
    names = list(parts[0])
    joined = {name: np.concatenate([part[name] for part in parts]) for name in names}
    units = {
        name: str(entry["unit"])
        for name, entry in mapping["columns"].items()
        if "unit" in entry and abs(float(entry.get("scale", 1.0))) == 1.0
    }
    meta = {**mapping.get("meta", {}), **read_meta(path.with_suffix(".json"))}
    return joined, {**meta, **({SOURCE_UNITS: units} if units else {})}


def _mapping(file: Path) -> dict[str, Any]:
    """Return the mapping of a columns.yaml, checked."""
    try:
        tree = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError) as error:
        raise LogError(f"{file}: cannot be read as YAML: {error}") from None
    if not isinstance(tree, dict) or not isinstance(tree.get("columns"), dict):
        raise LogError(f"{file}: expected a table `columns`, such as `columns: {{time: t}}`")
    for key in tree:
        if key not in KEYS:
            raise LogError(f"{file}: unknown key {key!r}{did_you_mean(key, KEYS)}")
    for name, entry in tree["columns"].items():
        if not known(str(name)):
            raise LogError(f"{file}: unknown column {name!r}; names: docs/reference/log_format.md")
        entry = dict(entry) if isinstance(entry, dict) else {"from": entry}
        if isinstance(entry.get("from"), int):
            entry["from"] = str(entry["from"])
        if not isinstance(entry.get("from"), str):
            raise LogError(f"{file}, column {name!r}: `from` (the source's name) is missing")
        wrong = [key for key in entry if key not in ENTRY]
        if wrong:
            raise LogError(
                f"{file}, column {name!r}: unknown key {wrong[0]!r}; {format_names(ENTRY)}"
            )
        if entry.get("unit") == REGISTER:
            entry = {**_as_servo_counts(tree.get("meta") or {}, f"{file}, {name}", name), **entry}
            entry["unit"] = entry.pop("counts")
        tree["columns"][name] = entry
    check_sources({n: _place(entry) for n, entry in tree["columns"].items()}, str(file))
    for kind in ("ctrl", "qpos"):
        if not any(str(name).startswith(f"{kind}.") for name in tree["columns"]):
            raise LogError(
                f"{file}: `{kind}.<joint>: {{from: NAME}}` is missing for at least one joint"
            )
    return tree


def _place(entry: Mapping[str, Any]) -> str:
    """Return where an entry is read from: a name, and the column of an array."""
    index = f", index {entry['index']}" if "index" in entry else ""
    return entry["from"].strip("/") + index


def _as_servo_counts(meta: dict[str, Any], place: str, name: str) -> dict[str, Any]:
    """Return a servo's counts by its robot's file: per turn, at the zero, and the sign."""
    kind, _, joint = name.partition(".")
    robot = meta.get("robot")
    if kind not in ("qpos", "ctrl") or not isinstance(robot, str):
        raise LogError(
            f"{place}: `unit: {REGISTER}` is of a position or a command of a robot that `meta: "
            f"{{robot: NAME}}` names; else write `{COUNTS}4096`, and the count at the `zero`"
        )
    servos = {servo.name: servo for servo in load_robot(robot).servos}
    if joint not in servos:
        hint = did_you_mean(joint, servos)
        names = format_names(servos)
        raise LogError(f"{place}: {robot} has no servo {joint!r}{hint}; it has {names}")
    servo = servos[joint]
    counts = f"{COUNTS}{servo.type.units.counts_per_turn}"
    return {"counts": counts, "zero": servo.zero, "scale": float(servo.sign)}


def _column(
    path: Path, file: Path, name: str, entry: dict[str, Any], source: dict[str, Any]
) -> np.ndarray:
    """Return one column in SI units, (T,); NaN where there is no reading."""
    values = _source(path, file, name, entry, source)
    kind = name.partition(".")[0]
    unit = str(entry.get("unit", "1"))
    factors = factor(unit, f"{file}, {name}", kind)
    if unit.startswith(COUNTS):
        values = _signed(values)
    try:
        zero, scale, offset = (
            float(entry.get(key, usual))
            for key, usual in (("zero", 0.0), ("scale", 1.0), ("offset", 0.0))
        )
    except (TypeError, ValueError):
        raise LogError(f"{file}, {name}: `zero`, `scale` and `offset` are numbers") from None
    values = scale * factors * (values - zero) + offset
    if "nanosec" not in entry:
        return values
    rest = _source(path, file, name, {"from": str(entry["nanosec"])}, source)
    return values - values[0] + NANO * rest


def _source(
    path: Path, file: Path, name: str, entry: dict[str, Any], source: dict[str, Any]
) -> np.ndarray:
    """Return an entry's values in the file, in the file's unit, (T,)."""
    wanted = entry["from"]
    key = wanted if wanted in source else wanted.strip("/")
    if key not in source:
        raise LogError(
            f"{path}: no {wanted!r}{did_you_mean(wanted, source)}, which {file.name} "
            f"names for {name!r}; available: {format_names(source)}"
        )
    values = np.asarray(source[key])
    if "index" in entry:
        if values.ndim != 2 or not 0 <= int(entry["index"]) < values.shape[1]:
            raise LogError(
                f"{path}, {wanted!r}: no column {entry['index']} in shape {values.shape}"
            )
        values = values[:, int(entry["index"])]
    if values.ndim == 2 and values.shape[1] == 1:
        values = values[:, 0]
    if values.ndim != 1:
        raise LogError(
            f"{path}, {wanted!r}: the shape is {values.shape}; add `index: 0` or another number to "
            f"{name!r} in {file.name}"
        )
    if values.dtype.kind in "fiub":
        return values.astype(float)
    read = {"time": seconds, "episode": labels}.get(name, numbers)
    return read(values.tolist(), f"{path}, {wanted!r}")


def _signed(values: np.ndarray) -> np.ndarray:
    """Return counts with their signs, where a register's negative numbers were read as large ones.

    They are known by the gap: none of the counts is in the middle half of the register's range.
    """
    most = float(np.nanmax(values, initial=0.0))
    for size in (2.0**bits for bits in SIGNED):
        middle = (values > size / 4) & (values < size * 3 / 4)
        if size * 3 / 4 <= most < size and not middle.any():
            return np.where(values > size / 2, values - size, values)
    return values


def _completed(
    path: Path, file: Path, columns: dict[str, np.ndarray], rate: Any, number: int
) -> dict[str, np.ndarray]:
    """Return the columns with `episode` and `time`, times from each episode's start."""
    length = len(next(iter(columns.values())))
    episode = columns.pop("episode", np.full(length, float(number)))
    if "time" not in columns and not (isinstance(rate, int | float) and rate > 0):
        raise LogError(f"{file}: `time` is missing; map it, or give the `rate` [Hz] of {path.name}")
    time = columns.pop("time", None)
    if time is None:
        time = np.arange(length) / float(rate)
    starts = np.flatnonzero(np.r_[True, np.diff(episode) != 0])
    start = time[starts][np.searchsorted(starts, np.arange(length), side="right") - 1]
    moved = {n: v - start if n.startswith("stamp.") else v for n, v in columns.items()}
    return {"episode": episode, "time": time - start, **moved}


def _episodes(path: Path, mapping: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the sources of each episode: arrays by their names."""
    if path.suffix.lower() == ".csv":
        yield csv_columns(path)
    elif path.suffix.lower() == ".parquet":
        table = parquet.read_table(path)
        wanted = {str(e[k]) for e in mapping["columns"].values() for k in TAKEN if k in e}
        yield {
            name: parquet.numbers(path, name, table[name]) if name in wanted else ()
            for name in table.column_names
        }
    else:
        ends = tuple(entry["from"].strip("/") for entry in mapping["columns"].values())
        arrays = dict(arrays_of(path, ends))
        pattern = str(mapping.get("episodes", "")).strip("/")
        if not pattern:
            yield arrays
            return
        groups = dict.fromkeys(
            group
            for name in arrays
            for group in _parents(name)
            if fnmatch.fnmatchcase(group, pattern) and group.count("/") == pattern.count("/")
        )
        if not groups:
            raise LogError(
                f"{path}: no group fits episodes: {pattern!r}; it has {format_names(arrays)}"
            )
        for group in sorted(groups, key=_natural):
            yield {n[len(group) + 1 :]: a for n, a in arrays.items() if n.startswith(f"{group}/")}


def header(path: Path) -> list[str]:
    """Return the names of a CSV's columns, whatever separates them; numbers where it has none."""
    lines, names = _lines(path)
    return names if lines else [str(number) for number in range(len(names))]


def _lines(path: Path) -> tuple[int, list[str]]:
    """Return how many lines of names a CSV begins with, and the names, or the first row's cells."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        first = file.readline()
        others = [file.readline() for _ in range(HEADERS)]
    separator = separator_of(first)
    head, *rows = [
        [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]
        for line in (first, *others)
    ]
    words = [_is_words(cells) for cells in (head, *rows)]
    if words[0] and words[1] and len(rows[0]) == len(head) and not words[2]:
        return 2, [" ".join(filter(None, pair)) for pair in zip(head, rows[0], strict=True)]
    return int(words[0]), head


def _is_words(cells: list[str]) -> bool:
    """Return whether a line holds names: no cell of it is a number or a date."""
    return bool(cells) and not any(is_value(cell) for cell in cells)


def csv_columns(path: Path) -> dict[str, list[str]]:
    """Return the columns of a CSV as texts."""
    names, (lines, _) = header(path), _lines(path)
    with path.open(encoding="utf-8-sig", newline="") as file:
        separator = separator_of(file.readline())
        file.seek(0)
        rows = [row for row in csv.reader(file, delimiter=separator) if row][lines:]
    for row, cells in enumerate(rows):
        if len(cells) != len(names):
            raise LogError(f"{path}, row {row}: {len(cells)} cells for {len(names)} columns")
    return {name: [cells[i] for cells in rows] for i, name in enumerate(names)}


def arrays_of(path: Path, ends: tuple[str, ...] | None) -> Iterator[tuple[str, Any]]:
    """Yield arrays of an HDF5 or Zarr file by their names, without the leading slash.

    Args:
        path: the file, or Zarr's folder.
        ends: how the names end of the arrays that are read, so that images stay where they are;
            None reads none and yields every array's shape.

    Raises:
        LogError: the package that reads it is missing, or the file is damaged.
    """
    package = "zarr" if path.suffix.lower() == ".zarr" else "h5py"
    if find_spec(package) is None:
        raise LogError(f"{path}: this needs {package}; install the extra 'data'")
    found: list[tuple[str, Any]] = []
    if package == "zarr":
        import zarr

        try:
            group = zarr.open_group(str(path), mode="r")
        except (OSError, ValueError, KeyError) as error:
            raise LogError(f"{path}: cannot be read as Zarr: {error}") from None
        members = [(n, a) for n, a in group.members(None) if isinstance(a, zarr.Array)]
        found = [(n, a.shape if ends is None else a[:]) for n, a in members if _wanted(n, ends)]
    else:
        import h5py

        def visit(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and item.ndim >= 1 and _wanted(name, ends):
                found.append((name, item.shape if ends is None else item[()]))

        try:
            with h5py.File(path) as file:
                file.visititems(visit)
        except OSError as error:
            raise LogError(f"{path}: cannot be read as HDF5: {error}") from None
    yield from found


def _wanted(name: str, ends: tuple[str, ...] | None) -> bool:
    return ends is None or name.endswith(ends)


def _parents(name: str) -> list[str]:
    parts = name.split("/")[:-1]
    return ["/".join(parts[: i + 1]) for i in range(len(parts))]


def _natural(name: str) -> list[Any]:
    """Order demo_2 before demo_10."""
    digits = "".join(c if c.isdigit() else " " for c in name).split()
    return [[int(d) for d in digits], name]
