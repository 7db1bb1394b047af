"""A trajectory log on disk row by row: whatever ends the program, the rows until then are there.

    writer = LogWriter(Path("swing.csv"), {"robot": "bench1"})
    writer.add({"episode": 0, "time": 0.0, "ctrl.hinge": 0.1, ...})     # swing.csv.part, and .json
    writer.close({"stopped": "Ctrl-C"})                                 # swing.csv

The first row's names are the columns. `hardware.log` reads a `.part` that was left over.
"""

import csv
import os
from collections.abc import Mapping, Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Any

from hardware.errors import LogError
from hardware.formats.csv_file import PART
from hardware.formats.names import INTEGER_KINDS
from hardware.log import write_meta

LEAST = 2  # rows of a log
KILLED = "the program ended before it could close this log"


def check_free(path: Path) -> None:
    """Refuse to write a log over another one, whole or begun, with a LogError."""
    for there in (path, path.with_name(path.name + PART)):
        if there.exists():
            raise LogError(f"{there} already exists; give another folder (out=), or move it away")


class LogWriter:
    """Writes one CSV log as its rows come.

    Args:
        path: where the whole log is to be, `.csv`.
        meta: what is known of it before its first row.

    Raises:
        LogError: there is a log already.
    """

    def __init__(self, path: Path, meta: Mapping[str, Any]) -> None:
        check_free(path)
        self.path, self._meta = path, dict(meta)
        self._part = path.with_name(path.name + PART)
        self._file: TextIOWrapper | None = None
        self._names: list[str] = []
        self._written = (0, 0)  # whole rows in the file, and where they end, as `tell` says

    def catch_up(self, rows: Sequence[Mapping[str, float]]) -> None:
        """Write those of all rows that are not in the file yet.

        Each is in it once, whatever interrupted an earlier call: what that left is written over.
        """
        for row in rows[self._written[0] :]:
            self.add(row)

    def add(self, row: Mapping[str, float]) -> None:
        """Write a row; the system has it when this returns."""
        if self._file is None:
            self._begin(row)
        assert self._file is not None
        count, end = self._written
        self._file.seek(end)
        cells = [row[name] for name in self._names]
        csv.writer(self._file, lineterminator="\n").writerow(
            int(cell) if name.partition(".")[0] in INTEGER_KINDS else float(cell)
            for name, cell in zip(self._names, cells, strict=True)
        )
        self._file.flush()
        self._written = count + 1, self._file.tell()

    def close(self, meta: Mapping[str, Any] | None = None) -> bool:
        """Give the log its name, and say whether there is one: it has at least two rows.

        Args:
            meta: the metadata of the whole log; None keeps what was known before.
        """
        if self._file is None:
            return False
        if not self._file.closed:
            self._file.truncate(self._written[1])
            self._file.close()
        whole = self._written[0] >= LEAST
        if not whole:
            self._part.unlink(missing_ok=True)
            self.path.with_suffix(".json").unlink(missing_ok=True)
        elif self._part.exists():
            write_meta(self.path, self._meta if meta is None else meta)
            os.replace(self._part, self.path)
        self._file = None
        return whole

    def _begin(self, row: Mapping[str, float]) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        write_meta(self.path, {**self._meta, "stopped": KILLED})
        self._names = list(row)
        file = self._part.open("w", encoding="utf-8", newline="")
        csv.writer(file, lineterminator="\n").writerow(self._names)
        self._written = 0, file.tell()
        self._file = file
