"""A trajectory log as CSV: the header names the columns, every cell is a number."""

import csv
import logging
import warnings
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hardware.errors import LogError, did_you_mean, format_names
from hardware.formats.cells import NANO, is_value, labels, numbers, seconds
from hardware.formats.names import INTEGER_KINDS, KINDS, REQUIRED, known
from hardware.formats.sidecar import read_meta

_logger = logging.getLogger(__name__)
LONGEST = 1_000_000  # characters of a header
PART = ".part"  # ends the name of a log that is being written
FIRST_LINE = 2  # of row 0
SPLIT = ("sec", "nanosec")  # a moment as ROS messages have it, in place of `time`


def is_log(path: Path) -> bool:
    """Say whether a path is a CSV file, or one that was not written to its end."""
    return whole(path).suffix.lower() == ".csv"


def whole(path: Path) -> Path:
    """Return the path of a log once it is whole: `log.csv` for `log.csv.part`."""
    return path.with_suffix("") if path.suffix == PART else path


def read_log(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the columns of a log, (T,) each, and what its JSON says.

    Raises:
        LogError: see `read` and `read_meta`.
    """
    columns = read(path)
    if path != whole(path):
        rows = len(next(iter(columns.values()), []))
        _logger.warning("%s: its program was ended before it was whole; %d rows", path, rows)
    return columns, read_meta(whole(path).with_suffix(".json"))


def read(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of the file, (T,) each.

    Raises:
        LogError: the header or a cell is wrong; the message says row, line and column.
    """
    header: list[str] = []
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            line = file.readline(LONGEST)
        if len(line) == LONGEST:
            raise LogError(
                f"{path}: the first line has {LONGEST:,} characters or more; it must name the "
                f"log's columns"
            )
        separator = separator_of(line)
        header = [name.strip() for name in next(csv.reader([line], delimiter=separator), [])]
        _check_header(path, header)
        columns = _columns(path, header, separator)
    except UnicodeDecodeError as error:
        reason = f"{error.reason} at byte {error.start}"
        raise LogError(f"{path}: this is not UTF-8 text ({reason})") from None
    except csv.Error as error:
        raise LogError(f"{path}: the first line names no columns ({error})") from None
    return keep_known(path, with_time(columns))


def with_time(columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return columns with `time`, put together where a log has `sec` and `nanosec` in its place."""
    if "time" in columns or not set(SPLIT) <= set(columns):
        return columns
    whole, rest = (columns.pop(name) for name in SPLIT)
    return {**columns, "time": whole - whole[0] + NANO * (rest - rest[0])}


def separator_of(line: str) -> str:
    """Return the separator of a table's cells: the most frequent of `,`, `;` and tab in a line."""
    return max(",;\t", key=line.count)


def _columns(path: Path, header: list[str], separator: str) -> dict[str, np.ndarray]:
    """Return the columns, (T,) each; those that a log cannot have may hold text, and are 0 then."""
    try:
        table = _numbers(path, separator)
        if table.size and table.shape[1] == len(header):
            return dict(zip(header, table.T.copy(), strict=True))
    except ValueError:
        pass
    rows = _rows(path, header, separator)
    if rows and not any(map(is_value, rows[0])):
        raise LogError(
            f"{path}, row 0 (line {FIRST_LINE}): no number in it; if it is a second line "
            "of names or units, remove it, or write a columns.yaml (docs/how-to/prepare_logs.md)"
        )
    found = {}
    for number, name in enumerate(header):
        cells = [cells[number] for cells in rows]
        if not (known(name) or name in SPLIT):
            found[name] = np.zeros(len(rows))
            continue
        read = {"time": seconds, "episode": labels}.get(name, numbers)
        found[name] = read(cells, f"{path}, column {name!r}", FIRST_LINE)
    return found


def _rows(path: Path, header: list[str], separator: str) -> list[list[str]]:
    """Return the cells of each row; raise LogError where they are more or fewer than columns."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file, delimiter=separator)
        next(reader)
        rows = [cells for cells in reader if cells]
    for row, cells in enumerate(rows):
        if len(cells) != len(header):
            raise LogError(
                f"{path}, row {row} (line {row + FIRST_LINE}): {len(cells)} cells, but the header "
                f"names {len(header)} columns"
            )
    return rows


def _numbers(path: Path, separator: str) -> np.ndarray:
    """Return all cells, (T, columns), of a file of numbers alone."""
    with path.open(encoding="utf-8-sig", newline="") as file, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*input contained no data")
        next(file)
        lines = file if path == whole(path) else (line for line in file if line.endswith("\n"))
        return np.loadtxt(lines, delimiter=separator, ndmin=2, comments=None, quotechar='"')


def write(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    """Write the columns; every number reads back as the same bits."""
    lists = [
        (values.astype(np.int64) if name.partition(".")[0] in INTEGER_KINDS else values).tolist()
        for name, values in columns.items()
    ]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*lists, strict=True))


def keep_known(path: Path, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the columns that a log can have; warn about the others."""
    if not set(REQUIRED) <= set(columns):
        return columns
    names = [*REQUIRED, "reward", *(f"{kind}.<name>" for kind in KINDS)]
    for name in [n for n in columns if not known(n)]:
        hint = did_you_mean(name.partition(".")[0], [*REQUIRED, "reward", *KINDS])
        message = "%s: column %r is left out%s; a log has %s"
        _logger.warning(message, path, name, hint, format_names(names))
        del columns[name]
    return columns


def _check_header(path: Path, header: list[str]) -> None:
    if not header:
        raise LogError(f"{path}: the file is empty; the first line of a log names its columns")
    if all(map(is_value, header)):
        raise LogError(
            f"{path}: the first line contains numbers, not names; write {','.join(REQUIRED)} and "
            "ctrl.<actuator>, qpos.<joint> above them in their order, or a columns.yaml that maps "
            f"them (`from: 0` is the first column)"
        )
    name, times = Counter(header).most_common(1)[0]
    if times > 1:
        raise LogError(f"{path}: column {name!r} occurs {times} times")
