"""Tables of results, as Markdown for people and CSV for programs.

    table = Table(("method", "return"), [("es_dr", Interval(1200.0, 900.0, 1500.0))])
    table.markdown()        # | es_dr | 1200 [900, 1500] |
    table.csv()             # method,return,return_low,return_high

Numbers keep their full precision in the CSV and three to four digits in Markdown. A missing value
is None: an empty field, and "–" in Markdown.
"""

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval

Cell = str | int | float | Interval | None


@dataclass
class Table:
    """Named columns, and rows of as many cells."""

    columns: Sequence[str]  # names; an Interval fills `name`, `name_low` and `name_high` of the CSV
    rows: list[Sequence[Cell]] = field(default_factory=list)  # the cells
    notes: list[str] = field(default_factory=list)  # sentences that stand below the Markdown table

    def __post_init__(self) -> None:
        for row in self.rows:
            self._check(row)

    def add(self, *cells: Cell) -> None:
        """Append a row."""
        self._check(cells)
        self.rows.append(cells)

    def _check(self, row: Sequence[Cell]) -> None:
        if len(row) != len(self.columns):
            raise ValueError(
                f"a row of {len(row)} cells in a table of {len(self.columns)} columns: {row}"
            )

    def markdown(self) -> str:
        """Return the table and its notes as Markdown."""
        texts = [[_escape(format_cell(cell)) for cell in row] for row in self.rows]
        numeric = [
            all(not isinstance(row[i], str) for row in self.rows) for i in range(len(self.columns))
        ]
        lines = [
            list(map(_escape, self.columns)),
            ["---:" if n else "---" for n in numeric],
            *texts,
        ]
        table = "\n".join("| " + " | ".join(line) + " |" for line in lines)
        return "\n\n".join([table, *self.notes]) + "\n"

    def csv(self) -> str:
        """Return the table as CSV."""
        wide = [
            any(isinstance(row[i], Interval) for row in self.rows) for i in range(len(self.columns))
        ]
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        names = [
            [n, f"{n}_low", f"{n}_high"] if w else [n]
            for n, w in zip(self.columns, wide, strict=True)
        ]
        writer.writerow([name for group in names for name in group])
        for row in self.rows:
            cells = [_fields(cell, w) for cell, w in zip(row, wide, strict=True)]
            writer.writerow([cell for group in cells for cell in group])
        return out.getvalue()

    def write(self, stem: str | Path, title: str = "") -> None:
        """Write `stem`.md, under a title, and `stem`.csv."""
        heading = f"# {title}\n\n" if title else ""
        write_text(f"{stem}.md", heading + self.markdown())
        write_text(f"{stem}.csv", self.csv())


def format_cell(cell: Cell) -> str:
    """Return a cell as a person reads it: about three digits, millions as `20.0 M`."""
    if cell is None:
        return "–"
    if isinstance(cell, str):
        return cell
    if isinstance(cell, Interval):
        return f"{format_cell(cell.value)} [{format_cell(cell.low)}, {format_cell(cell.high)}]"
    return _number(cell)


def _number(value: float) -> str:
    if not math.isfinite(value):
        return str(value)
    if abs(value) >= 1e6:
        return f"{value / 1e6:.1f} M"
    if abs(value) >= 10_000:
        return f"{value:,.0f}"
    if isinstance(value, int) or abs(value) >= 100:
        return f"{value:.0f}"
    return f"{value:.2f}" if abs(value) < 10 else f"{value:.1f}"


def _fields(cell: Cell, wide: bool) -> list[str | float]:
    if isinstance(cell, Interval):
        return list(cell)
    value = "" if cell is None else cell
    return [value, "", ""] if wide else [value]


def _escape(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
