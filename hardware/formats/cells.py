"""Cells of tables as numbers: lost readings, and moments as people write them.

    numbers(["0.1", "", "nan"], "run.csv, column 'qpos.a'")     # 0.1 and two NaN
    seconds(["2026-01-15T10:28:10.02Z", ...], "run.csv")        # from the first one on

A reading that was lost is an empty cell or one of the words that programs write for it; what is to
be done about it, `hardware.formats.repair` knows.
"""

import datetime
from collections.abc import Sequence
from typing import Any

import numpy as np

from hardware.errors import LogError

LOST = ("", "nan", "na", "n/a", "null", "none", "-", "--")  # in lower case
NANO = 1e-9


def numbers(cells: Sequence[Any], place: str, first_line: int | None = None) -> np.ndarray:
    """Return cells as numbers, (T,); NaN where there is none.

    Args:
        cells: texts, numbers or None.
        place: the file and the column.
        first_line: the file's line of row 0, if it has lines.

    Raises:
        LogError: a cell that is something else, with its row.
    """
    try:
        return np.asarray(cells, float)
    except (TypeError, ValueError):
        pass
    found = np.full(len(cells), np.nan)
    for row, cell in enumerate(cells):
        if not is_lost(cell):
            found[row] = _number(cell, _at(place, row, first_line))
    return found


def seconds(cells: Sequence[Any], place: str, first_line: int | None = None) -> np.ndarray:
    """Return moments as numbers, (T,): as they are, or of dates [s from the first one].

    Raises:
        LogError: a cell that is neither, with its row.
    """
    if not any(is_date(cell) for cell in cells[:1]):
        return numbers(cells, place, first_line)
    moments = []
    for row, cell in enumerate(cells):
        moment = _moment(cell)
        if moment is None:
            raise LogError(
                f"{_at(place, row, first_line)}: {cell!r} is not a date; the rows before have "
                "dates such as 2026-01-15T10:28:10.020"
            )
        moments.append(moment)
    try:
        return np.array([(moment - moments[0]).total_seconds() for moment in moments])
    except TypeError:
        raise LogError(
            f"{place}: some times have a time zone and some do not; use one format"
        ) from None


def labels(cells: Sequence[Any], place: str, first_line: int | None = None) -> np.ndarray:
    """Return episodes as numbers, (T,): names such as `ep_0` are counted as they come."""
    try:
        return numbers(cells, place, first_line)
    except LogError:
        order = {name: number for number, name in enumerate(dict.fromkeys(map(str, cells)))}
        if any(is_lost(name) for name in order):
            raise
        return np.array([order[str(cell)] for cell in cells], float)


def is_lost(cell: Any) -> bool:
    """Return whether a cell says that there is no reading."""
    return cell is None or (isinstance(cell, str) and cell.strip().lower() in LOST)


def _number(cell: Any, place: str) -> float:
    try:
        return float(cell)
    except (TypeError, ValueError):
        hint = "; write decimals with a point" if "," in str(cell) else ""
        raise LogError(f"{place}: {cell!r} is not a number{hint}") from None


def is_value(cell: str) -> bool:
    """Return whether a cell is a number or a moment, and no name."""
    try:
        float(cell)
    except ValueError:
        return is_date(cell)
    return True


def is_date(cell: Any) -> bool:
    """Return whether a cell is a moment: an ISO date with a time."""
    return _moment(cell) is not None


def _moment(cell: Any) -> datetime.datetime | None:
    """Return the moment of an ISO date with a time; None where a cell is none."""
    if isinstance(cell, datetime.datetime):
        return cell
    if not isinstance(cell, str) or ":" not in cell:
        return None
    try:
        return datetime.datetime.fromisoformat(cell.strip())
    except ValueError:
        return None


def _at(place: str, row: int, first_line: int | None) -> str:
    return f"{place}, row {row}" + ("" if first_line is None else f" (line {row + first_line})")
