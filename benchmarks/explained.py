"""How often the answers that are called explained are right, over all exams that are kept.

    python -m benchmarks.explained          # writes benchmarks/results/explained.md

Counts what the exams' scorers wrote: `blindcheck*.csv` of robots that the project's own emulator
moves, `thirdparty*.csv` of those that another engine does. An answer is right if its first cause is
a hidden effect at its place; where nothing is hidden, or an effect was withheld, `explained` is
wrong.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.cases import Row, read_csv
from benchmarks.study import command
from sim2real.exam.score import wilson
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

CALIBRATION = "thirdparty.csv"  # the half on which the search was mended


class Answer(NamedTuple):
    """An answer that is called explained."""

    file: str  # the table that it is in
    right: bool  # whether its first cause is


def read(path: Path) -> list[Answer]:
    """Return the answers of a table that are called explained, in its order."""
    # rank1 is empty where an effect was withheld, or nothing is hidden
    return [Answer(path.name, r["rank1"] == "1") for r in read_csv(path) if is_explained(r)]


def is_explained(row: Row) -> bool:
    """Return whether a case's answer is called explained."""
    return row["answer"].startswith("explained: ")


def table_of(answers: Sequence[Answer]) -> Table:
    """Return how many are right, by table."""
    table = Table(("table", "called explained", "right", "share"))
    for name in dict.fromkeys(one.file for one in answers):
        _add(table, name, [one for one in answers if one.file == name])
    other = [one for one in answers if one.file.startswith("thirdparty")]
    _add(table, "**another engine**", other)
    sealed = [one for one in other if one.file != CALIBRATION]
    _add(table, "**another engine, sealed draws**", sealed)
    return table


def _add(table: Table, name: str, answers: Sequence[Answer]) -> None:
    if answers:
        right = [one.right for one in answers]
        table.add(name, len(answers), sum(right), wilson(right))


def main(arguments: Sequence[str] | None = None) -> int:
    """Count, print, and keep what was counted."""
    parser = command("explained", __doc__, "results")
    folder = parser.parse_args(arguments).results
    paths = sorted([*folder.glob("blindcheck*.csv"), *folder.glob("thirdparty*.csv")])
    if not paths:
        parser.error(f"--results {folder}: no blindcheck*.csv or thirdparty*.csv; give the folder")
    answers = [one for path in paths for one in read(path)]
    text = (
        "# Answers that are called explained\n\n"
        "`python -m benchmarks.explained`. Brackets: 95 % intervals.\n\n"
        f"{table_of(answers).markdown()}"
    )
    print(text)
    write_text(folder / "explained.md", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
