"""The page of the seeds' tables: each row's figures beside ours, a verdict, or what it would take.

    page(load(), folder)        # docs/seeds.md as text

Everything on it comes from `rows.yaml`, which holds the seeds' own figures with their source, and
from the committed tables of results. A row whose results are not there says "not run" and how long
it takes.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from benchmarks.seeds.claims import Verdict, decide
from benchmarks.seeds.figures import Found, find
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.tables import Table, format_cell

ROWS = Path(__file__).with_name("rows.yaml")
KEYS = {
    *("id", "seed", "about", "source", "says", "measures", "claims", "statistic", "differs"),
    *("trainings", "cost", "command"),
}
SHARE = 0.25  # of rows that may be without a figure
VERBS = {  # of several claims
    "holds": "hold",
    "contradicted": "are contradicted",
    "undecided": "are undecided",
    "not run": "were not run",
}
HEAD = """# Five works, and our figures

The project began with five works. This page lists every row of their tables: the original figures
next to ours. `python -m benchmarks.seeds` generates it from
[benchmarks/results](../benchmarks/results/README.md) and from `benchmarks/seeds/rows.yaml`, which
contains the original figures and their sources.

* Figures are means over training seeds, or interquartile means if marked IQM. Brackets are 95 %
  bootstrap intervals over training seeds.
* A claim **holds** or is **contradicted** if the whole interval of the difference is above or
  below zero; otherwise it is **undecided**. The number after a claim is its margin. With fewer than
  five runs, intervals are too narrow; such claims are marked *few runs*. An undecided claim *needs*
  as many runs of each side as would decide it if margin and spread stayed as they are, at least
  five; the row's command takes them as `--seeds`.
* Steps and CPU minutes are per training seed; a dash means that they were not recorded.
"""


@dataclass(frozen=True)
class Row:
    """A row of the page."""

    about: Mapping[str, Any]  # what `rows.yaml` says of it
    found: Mapping[str, Found]  # our figures, by measure
    verdicts: Sequence[Verdict]  # of its claims
    hours: float | None  # processor time that all its runs take [h]; None where another row pays
    estimated: bool  # whether the hours are a forecast; else they were measured

    @property
    def run(self) -> bool:
        """Whether there is a figure of ours."""
        return any(found.values for found in self.found.values())


def load(path: Path = ROWS) -> dict[str, Any]:
    """Return the content of `rows.yaml`.

    Raises:
        Sim2RealError: rows of one id, or a row with a key that means nothing.
    """
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    ids = [row["id"] for row in content["rows"]]
    twice = sorted({i for i in ids if ids.count(i) > 1})
    if twice:
        raise Sim2RealError(f"{path.name}: two rows have the id {twice[0]}")
    for row in content["rows"]:
        if unknown := sorted(set(row) - KEYS):
            raise Sim2RealError(f"{path.name}: {unknown[0]!r} of row {row['id']} is unknown")
    return content


def rows(content: Mapping[str, Any], folder: Path) -> list[Row]:
    """Return the rows with our figures of a folder of results."""
    tables = content["tables"]
    measures = {
        f"{row['id']}.{name}": find(measure["ours"], tables, folder)
        for row in content["rows"]
        for name, measure in row["measures"].items()
        if measure.get("ours")
    }
    spent = {
        name: find({"table": "seeds", "where": {"training": name}}, tables, folder).minutes
        for name in content["trainings"]
    }
    return [_row(about, measures, content["trainings"], spent) for about in content["rows"]]


def _row(
    about: Mapping[str, Any],
    measures: Mapping[str, Found],
    trainings: Mapping[str, Any],
    spent: Mapping[str, float | None],
) -> Row:
    own = {name: measures.get(f"{about['id']}.{name}", Found({})) for name in about["measures"]}
    statistic = about.get("statistic", "mean")
    verdicts = [decide(c, about["id"], measures, statistic) for c in about.get("claims", ())]
    names = about.get("trainings", ())
    costs = [(trainings[n]["runs"], spent[n] or trainings[n]["minutes"]) for n in names]
    if "cost" in about:
        costs.append((about["cost"]["runs"], about["cost"]["minutes"]))
    hours = sum(runs * minutes for runs, minutes in costs) / 60 if costs else None
    return Row(about, own, verdicts, hours, "cost" in about or any(not spent[n] for n in names))


def page(content: Mapping[str, Any], folder: Path) -> str:
    """Return the page as Markdown."""
    every = rows(content, folder)
    parts = [HEAD, _summary(every)]
    for seed, title in content["seeds"].items():
        parts += [
            f"## {title[0].upper()}{title[1:]}\n",
            _table([r for r in every if r.about["seed"] == seed]),
        ]
    parts += ["## Rows not run, cheapest first\n", _missing(every, content["seeds"])]
    return "\n".join(part.rstrip("\n") + "\n" for part in parts)


def _summary(every: Sequence[Row]) -> str:
    missing = sum(not row.run for row in every)
    answers = [verdict.answer for row in every for verdict in row.verdicts]
    counts = {answer: answers.count(answer) for answer in answers}
    said = [f"{counts[answer]} {verb}" for answer, verb in VERBS.items() if answer in counts]
    listed = " and ".join(part for part in (", ".join(said[:-1]), *said[-1:]) if part)
    return (
        f"We have figures for {len(every) - missing} of {len(every)} rows; {missing} "
        f"({missing / len(every):.0%}) were not run (at most {SHARE:.0%} are allowed). "
        f"Of {len(answers)} claims, {listed}."
    )


def _table(chosen: Sequence[Row]) -> str:
    columns = ("row", "original", "ours", "runs", "steps", "CPU min", "verdict", "command")
    table = Table(columns)
    for row in chosen:
        table.add(*_cells(row))
    return table.markdown()


def _cells(row: Row) -> Iterator[str]:
    about = row.about
    statistic = about.get("statistic", "mean")
    yield _lines([f"**{about['about']}**", about["source"], about.get("differs")])
    yield _lines(
        [about.get("says")]
        + [f"{name}: {m['seed']}" for name, m in about["measures"].items() if "seed" in m]
    )
    figures = [
        f"{name}: {format_cell(found.interval(statistic))}"
        for name, found in row.found.items()
        if found.values
    ]
    hours = "" if row.hours is None else f", {'about ' * row.estimated}{row.hours:.2g} h"
    yield _lines(figures + (["(IQM)"] if statistic == "iqm" and figures else [])) or (
        f"**not run**{hours}"
    )
    counts = [len(found.values) for found in row.found.values() if found.values]
    yield _span(counts, "d")
    yield _span([found.steps for found in row.found.values() if found.steps], ",.0f")
    yield _span([found.minutes for found in row.found.values() if found.minutes], ".2g")
    yield _lines([str(verdict) for verdict in row.verdicts]) or "–"
    yield _command(row)


def _command(row: Row) -> str:
    """Return the command of a row in code; a row that needs what is not there yet says so."""
    command = row.about["command"]
    return "to be built" if command is None else f"`{command}`"


def _lines(parts: Sequence[str | None]) -> str:
    return "<br>".join(part for part in parts if part)


def _span(numbers: Sequence[float], form: str) -> str:
    """Return the least and the largest of some numbers, or the one that they are."""
    if not numbers:
        return "–"
    shown = [format(number, form) for number in (min(numbers), max(numbers))]
    return shown[0] if shown[0] == shown[1] else f"{shown[0]} to {shown[1]}"


def _missing(every: Sequence[Row], titles: Mapping[str, str]) -> str:
    left = sorted((r for r in every if not r.run), key=lambda row: row.hours or 0.0)
    table = Table(("row", "work", "CPU hours", "command"))
    for row in left:
        hours = "–" if row.hours is None else f"{'about ' * row.estimated}{row.hours:.2g}"
        table.add(
            row.about["about"], titles[row.about["seed"]].partition(",")[0], hours, _command(row)
        )
    if not left:
        return "Nothing."
    allowed = int(SHARE * len(every))
    first = max(0, len(left) - allowed)
    many = "the first row" if first == 1 else f"the first {first} rows"
    note = f"After {many} of this table, at most {SHARE:.0%} would have no figure."
    return table.markdown() + (f"\n{note}\n" if first else "")
