"""The runner of studies by cases: each is drawn from a seed and a number, judged once, and kept.

    cases = Cases(RESULTS / "worth.csv", FIELDS)
    own = cases.run(seed, 40, judge)            # judges what is missing, returns the seed's rows
    share([1, 0, 1])                            # 0.67 [0.09, 0.99], exact binomial

A case is called seed-number. Its rows stand in one CSV file, which is written after each case, so
that a study goes on where it was stopped, and several seeds share a file.
"""

import csv
import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import numpy as np
from scipy.stats import binomtest

from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval, Statistic, bootstrap, mean
from sim2real.runs.tables import Table

DRAWS = 5000  # resamples of an interval
log_ = logging.getLogger(__name__)
Row = dict[str, str]
Named = TypeVar("Named", bound=tuple)  # a NamedTuple


def read_csv(path: Path) -> list[Row]:
    """Return the rows of a CSV file; none if it is not there."""
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def write_csv(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows, one at least, whose columns are those of the first."""
    rows = list(rows)
    table = Table(tuple(rows[0]))
    for row in rows:
        table.add(*(row[name] for name in table.columns))
    write_text(path, table.csv())


def over_runs(
    values: Sequence[float] | np.ndarray, statistic: Statistic = mean
) -> Interval | float | None:
    """Return a statistic of one number a run, with its 95 % bootstrap interval over the runs.

    Alone for one run, None for none.
    """
    if len(values) < 2:
        return float(values[0]) if len(values) else None
    rng = np.random.default_rng(0)
    return bootstrap(np.array(values)[:, None], statistic, rng, draws=DRAWS, resample="rows")


class Cases:
    """Rows of cases in a CSV file."""

    def __init__(self, path: Path, fields: Sequence[str], key: str = "case") -> None:
        self.path, self.fields, self.key = path, fields, key
        self.rows = [{name: row.get(name, "") for name in fields} for row in read_csv(path)]

    def run(
        self,
        seed: int,
        count: int,
        judge: Callable[[int], Iterable[Mapping[str, Any]]],
        **same: str,
    ) -> list[Row]:
        """Judge the cases of a seed that are not there, and return all rows of the seed.

        The judge makes the rows of the case of a number; `same` is what their further columns hold.
        """
        for number in range(count):
            name = f"{seed}-{number}"
            if any(row[self.key] == name for row in self._of(same)):
                continue
            for made in judge(number):
                self.rows.append({field: str(made.get(field, "")) for field in self.fields})
                log_.info("%s", " | ".join(self.rows[-1].values()))
            write_csv(self.path, self.rows)
        return [row for row in self._of(same) if row[self.key].startswith(f"{seed}-")]

    def _of(self, same: Mapping[str, str]) -> list[Row]:
        return [row for row in self.rows if same.items() <= row.items()]


def typed(kind: type[Named], rows: Sequence[Row]) -> list[Named]:
    """Return rows as named tuples, each cell as its field's type reads it."""
    reads = get_type_hints(kind)
    return [kind(**{name: read(row[name]) for name, read in reads.items()}) for row in rows]


def share(values: Sequence[bool | int]) -> Interval:
    """Return the part that is true with its exact (Clopper and Pearson) 95 % interval."""
    low, high = binomtest(sum(values), len(values)).proportion_ci(method="exact")
    return Interval(sum(values) / len(values), float(low), float(high))
