"""Our figures: what a committed table of results says about one row, run by run.

    find({"table": "toys", "where": {"operator": "none"}, "value": "after"}, tables, folder)
    # Found(values={"0": -68.2, "1": -68.3}, steps=8860965.0, minutes=0.03)

A query names a table of `rows.yaml`, what its columns must hold, and the column of the values. A
list of two numbers is a range. Where a run has several rows, as a grid has cells, their mean
counts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import over_runs, read_csv
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.statistics import Interval, Statistic, iqm, mean

STATISTICS: dict[str, Statistic] = {"mean": mean, "iqm": iqm}
KEYS = {"table", "where", "outside", "value"}


@dataclass(frozen=True)
class Found:
    """Figures of the runs that a query found; None where the table has none."""

    values: Mapping[str, float]  # a figure by run
    steps: float | None = None  # environment steps of a training, the median
    minutes: float | None = None  # processor time of a training [min], the mean

    @property
    def column(self) -> np.ndarray:
        """The figures in the order of their runs, (n, 1)."""
        return np.array([[self.values[run]] for run in sorted(self.values)])

    def interval(self, statistic: str) -> Interval | float | None:
        """Return the figure with its interval over runs; alone for one run, None for none."""
        values = [self.values[run] for run in sorted(self.values)]
        return over_runs(values, STATISTICS[statistic])


def find(query: Mapping[str, Any], tables: Mapping[str, Any], folder: Path) -> Found:
    """Return what a query finds; nothing where the table is not there yet.

    Args:
        query: see the module's text.
        tables: the tables by name: `file`, and the columns `run`, `value`, `steps` and either
            `minutes` or `seconds`, as far as it has them.
        folder: of the results.

    Raises:
        Sim2RealError: a query or a table that names what is not there.
    """
    unknown = sorted(set(query) - KEYS) or sorted({query["table"]} - set(tables))
    if unknown:
        raise Sim2RealError(f"rows.yaml: {unknown[0]!r} in {dict(query)} is unknown")
    table = tables[query["table"]]
    lines = read_csv(folder / table["file"])
    columns = tuple(lines[0]) if lines else ()
    where, outside = query.get("where", {}), query.get("outside", {})
    value = query.get("value", table["value"])
    wanted = {*where, *outside, value, table["run"]}
    if missing := sorted(wanted - set(columns)) if columns else []:
        raise Sim2RealError(
            f"rows.yaml: {table['file']} has no column {missing[0]!r}; it has {', '.join(columns)}"
        )
    chosen = [line for line in lines if _within(line, where)]
    if outside:
        chosen = [line for line in chosen if not _within(line, outside)]
    runs: dict[str, list[float]] = {}
    for line in chosen:
        runs.setdefault(line[table["run"]], []).append(float(line[value]))
    minutes = _numbers(chosen, table.get("minutes")) or [
        seconds / 60 for seconds in _numbers(chosen, table.get("seconds"))
    ]
    steps = _numbers(chosen, table.get("steps"))
    return Found(
        {run: float(np.mean(values)) for run, values in runs.items()},
        float(np.median(steps)) if steps else None,
        float(np.mean(minutes)) if minutes else None,
    )


def _within(line: Mapping[str, str], where: Mapping[str, Any]) -> bool:
    for column, wanted in where.items():
        if isinstance(wanted, list):
            if not wanted[0] <= float(line[column]) <= wanted[1]:
                return False
        elif isinstance(wanted, str):
            if line[column] != wanted:
                return False
        elif float(line[column]) != wanted:
            return False
    return True


def _numbers(lines: Sequence[Mapping[str, str]], column: str | None) -> list[float]:
    return [float(line[column]) for line in lines if column and line[column]]
