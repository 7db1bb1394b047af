"""What fresh exams say of the diagnosis by one likelihood, together.

    python -m benchmarks.likelihood         # writes benchmarks/results/likelihood.md

Counts what the exams' scorers wrote: those since the release, and those of versions before, between
which the engine changed. Each was drawn anew and opened once, so that none of its cases was seen
before.
"""

import sys
from collections.abc import Sequence

from benchmarks.cases import Row, read_csv
from benchmarks.explained import is_explained
from benchmarks.study import command
from sim2real.exam.score import wilson
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

# By title: robots that MuJoCo moves, robots that Drake moves, mistakes in logs, effects put into
# real logs.
EXAMS = {
    "Since release 0.2.0": (
        tuple(f"blindcheck_{seed}.csv" for seed in range(2057, 2074)),
        tuple(f"thirdparty_{seed}.csv" for seed in range(61, 83)),
        (
            "log_mistakes.csv",
            *(f"log_mistakes_{seed}.csv" for seed in (2062, 2064, 2065, 2066, 2067)),
        ),
        tuple(f"blindcheck_real_{seed}.csv" for seed in (9, 10, 13)),
    ),
    "Release 0.2.0 and versions before it": (
        tuple(f"blindcheck_{seed}.csv" for seed in (2049, 2051, 2053, 2054, 2055, 2056)),
        tuple(f"thirdparty_{seed}.csv" for seed in (55, 56, 57, 58, 59, 60)),
        ("log_mistakes_2061.csv",),
        (),
    ),
}
HIDDEN = ("one", "two")  # kinds of cases that hide what can be named


def table_of(
    own: Sequence[Row], other: Sequence[Row], mistakes: Sequence[Row], real: Sequence[Row]
) -> Table:
    """Return how many answers to each question were so, with 95 % intervals."""
    called = [row for row in other if is_explained(row)]
    questions = {
        "hidden effect named first": [row["rank1"] == "1" for row in own if row["kind"] in HIDDEN],
        "healthy robot blamed": [row["alarm"] == "1" for row in own if row["kind"] == "none"],
        "`explained` although the true effect is excluded": [
            is_explained(row) for row in own if row["kind"] == "excluded"
        ],
        "true value in its 90 % interval": [row["covered"] == "1" for row in own if row["covered"]],
        "other engine: `explained` and right": [row["rank1"] == "1" for row in called],
        "other engine: `explained` although no effect of the library acts": [
            is_explained(row) for row in other if row["kind"] == "outside"
        ],
        "mistake in a log named": [row["named"] == "1" for row in mistakes],
        "mistake in a log called an effect": [row["blamed"] == "1" for row in mistakes],
        "effect put into a real log named first": [row["rank1"] == "1" for row in real],
    }
    table = Table(("question", "cases", "so", "share"))
    for question, answers in questions.items():
        if answers:
            table.add(question, len(answers), sum(answers), wilson(answers))
    return table


def main(arguments: Sequence[str] | None = None) -> int:
    """Count, print, and keep what was counted."""
    parser = command("likelihood", __doc__, "results")
    folder = parser.parse_args(arguments).results
    names = [name for exams in EXAMS.values() for name in sum(exams, ())]
    missing = [name for name in names if not (folder / name).is_file()]
    if missing:
        parser.error(f"--results {folder}: no {', '.join(missing)}; give the folder")
    text = "# Fresh exams of one likelihood\n\n`python -m benchmarks.likelihood`. "
    text += "Brackets: 95 % intervals.\n"
    for title, exams in EXAMS.items():
        cases = ([r for name in names for r in read_csv(folder / name)] for names in exams)
        table = table_of(*cases).markdown()
        names = "`, `".join(sum(exams, ()))
        text += f"\n## {title}\n\nOf `{names}`.\n\n{table.rstrip()}\n"
    print(text)
    write_text(folder / "likelihood.md", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
