"""Registered log formats, in the order in which they are tried."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hardware.errors import LogError
from hardware.formats import bam, csv_file, lerobot, mapped, messages, parquet, sage

Columns = tuple[dict[str, np.ndarray], dict[str, Any]]  # values (T,) by column, and metadata


@dataclass(frozen=True)
class Format:
    """A kind of file or folder that contains a log.

    Args:
        name: its common name.
        is_log: returns whether a path is such a log, without reading all of it.
        read: returns the log's columns, (T,) each in SI units, and its metadata.
    """

    name: str
    is_log: Callable[[Path], bool]
    read: Callable[[Path], Columns]


FORMATS = [
    Format("a folder of SAGE", sage.is_log, sage.read),
    Format("a rosbag2 folder or .mcap", messages.is_log, messages.read),
    Format("a .csv, .parquet, .h5 or .zarr with a columns.yaml", mapped.is_log, mapped.read),
    Format("a .parquet of LeRobot", lerobot.is_log, lerobot.read),
    Format("a .parquet", parquet.is_log, parquet.read),
    Format("a .csv", csv_file.is_log, csv_file.read_log),
    Format("a .json of BAM", bam.is_log, bam.read),
]


def register(format: Format) -> None:
    """Register a format, which is tried before the existing ones."""
    FORMATS.insert(0, format)


def find(path: Path) -> Format | None:
    """Return the first format that says a path is its log, or None."""
    return next((format for format in FORMATS if format.is_log(path)), None)


def known() -> str:
    """Return the formats' names, as a sentence lists them."""
    *most, last = [format.name for format in FORMATS]
    return f"{', '.join(most)} or {last}"


def refuse(path: Path) -> LogError:
    """Return the error for a path that is not a log."""
    if path.suffix in mapped.ARRAYS:
        return LogError(
            f"{path}: a {path.suffix} file needs a {mapped.NAME} next to it that maps its arrays "
            f"to columns; `sim2real convert {path.name} columns={mapped.NAME}` "
            "writes one to start from"
        )
    what = "a folder" if path.is_dir() else path.suffix or "a file without an ending"
    return LogError(f"{path}: a log is {known()}; this is {what}")
