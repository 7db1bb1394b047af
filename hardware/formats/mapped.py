"""Logs under other names, in CSV, Parquet, HDF5 or Zarr: a `columns.yaml` says what is what.

    # columns.yaml, beside the log (or NAME.columns.yaml for one log)
    columns:
      time:       {from: t_ms, unit: ms}
      ctrl.elbow: {from: cmd_elbow, unit: deg}
      qpos.elbow: {from: pos_elbow, unit: deg, scale: -1, offset: 0.1}   # offset in SI, after scale
      qvel.elbow: {from: /obs/qvel, index: 1}                            # HDF5, Zarr: array, column
    episodes: /data/demo_*          # HDF5, Zarr: one episode a group, names below are within it
    rate: 50                        # Hz, where there is no time
    meta: {model: arm.xml}

Without `episode` all rows are one episode, which starts at 0 s. `Mapping.guess` writes such a file
from a header, to be read over by a person. HDF5 needs h5py and Zarr zarr (the extra `data`).
"""

from __future__ import annotations

import csv
import fnmatch
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hardware.errors import LogError, did_you_mean, format_names
from hardware.formats import parquet
from hardware.formats.csv_file import separator_of
from hardware.formats.names import known
from hardware.formats.sidecar import read_meta
from hardware.formats.units import factor

NAME = "columns.yaml"
ARRAYS = (".h5", ".hdf5", ".zarr")
TABLES = (".csv", ".parquet")
ENTRY = ("from", "index", "unit", "scale", "offset")
KEYS = ("columns", "episodes", "rate", "meta")


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
    meta = {**mapping.get("meta", {}), **read_meta(path.with_suffix(".json"))}
    return joined, meta


def _mapping(file: Path) -> dict[str, Any]:
    """Return the mapping of a columns.yaml, checked."""
    try:
        tree = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, yaml.YAMLError) as error:
        raise LogError(f"{file}: this cannot be read as YAML: {error}") from None
    if not isinstance(tree, dict) or not isinstance(tree.get("columns"), dict):
        raise LogError(f"{file}: a table `columns` is needed, such as `columns: {{time: t}}`")
    for key in tree:
        if key not in KEYS:
            raise LogError(f"{file}: there is no key {key!r}{did_you_mean(key, KEYS)}")
    for name, entry in tree["columns"].items():
        if not known(str(name)):
            raise LogError(f"{file}: a log has no column {name!r}; see docs/logs.md for the names")
        entry = {"from": entry} if isinstance(entry, str) else entry
        if not isinstance(entry, dict) or not isinstance(entry.get("from"), str):
            raise LogError(f"{file}, column {name!r}: `from` is needed: the source's name")
        wrong = [key for key in entry if key not in ENTRY]
        if wrong:
            raise LogError(
                f"{file}, column {name!r}: there is no key {wrong[0]!r}; {format_names(ENTRY)}"
            )
        tree["columns"][name] = entry
    return tree


def _column(
    path: Path, file: Path, name: str, entry: dict[str, Any], source: dict[str, Any]
) -> np.ndarray:
    """Return one column in SI units, (T,)."""
    wanted = entry["from"]
    key = wanted if wanted in source else wanted.strip("/")
    if key not in source:
        raise LogError(
            f"{path}: there is no {wanted!r}{did_you_mean(wanted, source)}, which {file.name} "
            f"names for {name!r}; there are {format_names(source)}"
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
    try:
        values = values.astype(float)
    except (TypeError, ValueError):
        raise LogError(f"{path}, {wanted!r}: not all of it is numbers") from None
    scale = float(entry.get("scale", 1.0)) * factor(str(entry.get("unit", "1")), f"{file}, {name}")
    return scale * values + float(entry.get("offset", 0.0))


def _completed(
    path: Path, file: Path, columns: dict[str, np.ndarray], rate: Any, number: int
) -> dict[str, np.ndarray]:
    """Return the columns with `episode` and `time`, times from each episode's start."""
    length = len(next(iter(columns.values())))
    episode = columns.pop("episode", np.full(length, float(number)))
    if "time" not in columns and not rate:
        raise LogError(
            f"{file}: `time` is needed, or the `rate` [Hz] at which {path.name} was made"
        )
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
        yield _csv(path)
    elif path.suffix.lower() == ".parquet":
        table = parquet.read_table(path)
        yield {name: parquet.numbers(path, name, table[name]) for name in table.column_names}
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
    """Return the names in the first line of a CSV, whatever separates them."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        line = file.readline()
    return [name.strip() for name in next(csv.reader([line], delimiter=separator_of(line)), [])]


def _csv(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of a CSV with a header."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        line = file.readline()
        rows = [row for row in csv.reader(file, delimiter=separator_of(line)) if row]
    names = header(path)
    for row, cells in enumerate(rows):
        if len(cells) != len(names):
            raise LogError(f"{path}, row {row}: {len(cells)} cells for {len(names)} columns")
    return {name: np.array([cells[i] for cells in rows]) for i, name in enumerate(names)}


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
            raise LogError(f"{path}: this cannot be read as Zarr: {error}") from None
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
            raise LogError(f"{path}: this cannot be read as HDF5: {error}") from None
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
