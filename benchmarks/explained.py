"""How often the answers that are called explained are right, over all exams that are kept.

    python -m benchmarks.explained          # writes benchmarks/results/explained.md

Counts what the exams' scorers wrote: `blindcheck*.csv` of robots that the project's own emulator
moves, `thirdparty*.csv` of those that another engine does. An answer is right if its first cause is
a hidden effect at its place; where nothing is hidden, or an effect was withheld, `explained` is
wrong. Of answers that explain by two effects at one joint it counts those of which one knows that
both act like another effect (`Effect.imitates`): no such answer is called explained any more.
"""

from __future__ import annotations

import csv
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.study import command
from envs.effects import EFFECTS
from sim2real.exam.score import wilson
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

RESULTS = Path(__file__).parent / "results"
EXPLAINED = "explained"
CALIBRATION = "thirdparty.csv"  # the half on which the search was mended
CAUSE = re.compile(r"(?P<effect>\w+)(?: at (?P<place>\w+))?")  # as `exam.score.words` says it


class Answer(NamedTuple):
    """An answer that is called explained.

    Args:
        file: the table that it is in.
        case: its name.
        causes: effect and place of each; "" is the whole robot.
        right: whether its first cause is.
    """

    file: str
    case: str
    causes: tuple[tuple[str, str], ...]
    right: bool

    @property
    def is_pair(self) -> bool:
        """Whether it names two effects at one joint, or two of the whole robot."""
        return len(self.causes) == 2 and self.causes[0][1] == self.causes[1][1]

    @property
    def imitates(self) -> bool:
        """Whether it is such a pair of which one knows that both act like another effect."""
        (one, _), (other, _) = self.causes if self.is_pair else (("", ""),) * 2
        return any(b in EFFECTS[a].imitates for a, b in ((one, other), (other, one)) if a)


def read(path: Path) -> list[Answer]:
    """Return the answers of a table that are called explained, in its order."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    verdict = f"{EXPLAINED}: "
    return [
        Answer(
            path.name,
            row["case"],
            _causes(row["answer"].removeprefix(verdict)),
            row["rank1"] == "1",  # empty where an effect was withheld, or nothing is hidden
        )
        for row in rows
        if row["answer"].startswith(verdict)
    ]


def _causes(words: str) -> tuple[tuple[str, str], ...]:
    found = [CAUSE.match(part.strip()) for part in words.split(";")]
    return tuple((one["effect"], one["place"] or "") for one in found if one)


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


def pairs_of(answers: Sequence[Answer]) -> Table:
    """Return the answers that explain by two effects at one joint."""
    table = Table(("table", "case", "causes", "act like another effect", "right"))
    for one in answers:
        if one.is_pair:
            causes = ", ".join(f"{effect} at {place or 'all'}" for effect, place in one.causes)
            told = ["yes" if answer else "no" for answer in (one.imitates, one.right)]
            table.add(one.file, one.case, causes, *told)
    for title, kind in (("that act like another", True), ("of other kinds", False)):
        own = [one for one in answers if one.is_pair and one.imitates == kind]
        table.notes.append(f"Pairs {title}: {len(own)}, of which {_count(own)} right.")
    return table


def _add(table: Table, name: str, answers: Sequence[Answer]) -> None:
    if answers:
        share = wilson([one.right for one in answers])
        table.add(name, len(answers), _count(answers), share)


def _count(answers: Sequence[Answer]) -> int:
    return sum(one.right for one in answers)


def main(arguments: Sequence[str] | None = None) -> int:
    """Count, print, and keep what was counted."""
    parser = command("explained", __doc__)
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the tables")
    folder = parser.parse_args(arguments).results
    paths = sorted([*folder.glob("blindcheck*.csv"), *folder.glob("thirdparty*.csv")])
    if not paths:
        parser.error(f"--results {folder}: no blindcheck*.csv or thirdparty*.csv; give the folder")
    answers = [one for path in paths for one in read(path)]
    text = (
        "# Answers that are called explained\n\n"
        "`python -m benchmarks.explained`. Brackets: 95 % intervals.\n\n"
        f"{table_of(answers).markdown()}\n## By two effects at one joint\n\n"
        f"{pairs_of(answers).markdown()}"
    )
    print(text)
    write_text(folder / "explained.md", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
