"""The numbers of a run as CSV files, a row an iteration; a resumed run continues them seamlessly.

    metrics = MetricsFile("run/metrics.csv")
    metrics.write({"train/iteration": 1, "train/return": 12.5})
    metrics.cut("train/iteration", 1)        # after a crash: forget what came after the checkpoint

Times are in `timing.csv` next to it, so that `metrics.csv` of a resumed run equals that
of an uninterrupted one byte for byte.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path

from sim2real.runs.files import write_text


class MetricsFile:
    """Rows of named numbers. A row is on disk when `write` returns; a kill can tear only the last.

    Args:
        path: the file; it need not exist.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._columns: list[str] = []
        if self.path.exists():
            with self.path.open(encoding="utf-8", newline="") as file:
                self._columns = next(csv.reader(file), [])

    def write(self, row: Mapping[str, float]) -> None:
        """Append a row. Names that are new add columns, which earlier rows leave empty."""
        if new := [name for name in row if name not in self._columns]:
            self._rewrite(self.rows(), [*self._columns, *new])
        with self.path.open("a", encoding="utf-8", newline="") as file:
            file.write(_line([_text(row.get(name)) for name in self._columns]))

    def rows(self) -> list[dict[str, str]]:
        """Return the rows as text, a torn last one left out."""
        if not self.path.exists():
            return []
        text = self.path.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]
        return list(csv.DictReader(io.StringIO(whole, newline="")))

    def clear(self) -> None:
        """Forget all rows and columns, and the file."""
        self.path.unlink(missing_ok=True)
        self._columns = []

    def truncate(self, key: str, last: int, source: MetricsFile | None = None) -> None:
        """Keep the rows in which `key` is at most `last`: of this file or, if given, another's."""
        source = source or self
        kept = [row for row in source.rows() if int(row[key]) <= last]
        if source._columns:
            self._rewrite(kept, source._columns)

    def _rewrite(self, rows: Iterable[Mapping[str, str]], columns: list[str]) -> None:
        lines = [
            _line(columns),
            *(_line([row.get(name) or "" for name in columns]) for row in rows),
        ]
        write_text(self.path, "".join(lines))
        self._columns = list(columns)


def _line(cells: list[str]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerow(cells)
    return out.getvalue()


def _text(value: float | None) -> str:
    """Write a number with all its digits."""
    return "" if value is None else repr(value)
