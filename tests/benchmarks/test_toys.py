"""The comparison of adaptation operators: its table, and its findings on a few seeds."""

from pathlib import Path
from typing import Any

import pytest

from benchmarks.cases import over_runs, read_csv, write_csv
from benchmarks.toys import EXPERIMENTS, run, table
from sim2real.runs.statistics import Interval

CORNERS, CORRUPTED = "corners, K = 20", "nav2d, 30 % corrupted"


def make_row(operator: str, seed: int, after: float) -> dict[str, Any]:
    """One row of results on the corners."""
    keys = {"experiment": CORNERS, "operator": operator, "seed": seed, "iterations": 1}
    return keys | {"frames": 1, "cpu_seconds": 2.0, "before": -400.0, "after": after}


def test_table_compares_each_operator_with_the_next(tmp_path: Path) -> None:
    """Rows survive the CSV file; means, intervals and gaps by seed are those of the numbers."""
    rows = [make_row("gradient", seed, -300.0 - seed) for seed in range(3)]
    rows += [make_row("hill climbing", seed, -200.0 - seed) for seed in (2, 0, 1)]
    write_csv(tmp_path / "toys.csv", rows)
    first, second = table(read_csv(tmp_path / "toys.csv")).rows
    after, gain, gap = (-201, -202, -200), (199, 198, 200), (100, 100, 100)
    assert list(first[3:6]) == [after, gain, gap]
    assert second[:3] == (CORNERS, "gradient", (-400, -400, -400)) and second[5] is None
    assert read_csv(tmp_path / "missing.csv") == []


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    ("name", "better", "worse"),
    [
        ("nav2d, K = 20", "hill climbing", "gradient"),
        ("nav2d, K = 20", "gradient", "none"),
        (CORNERS, "hill climbing", "gradient"),
        (CORNERS, "hill climbing", "none"),
        ("corners, K = 5", "hill climbing", "gradient"),
        (CORRUPTED, "batch", "average"),
    ],
)
def test_findings(name: str, better: str, worse: str) -> None:
    """Over 3 seeds the gap between two operators has an interval above 0."""
    assert {better, worse} < set(EXPERIMENTS[name].operators)
    gaps = [run(name, better, seed)["after"] - run(name, worse, seed)["after"] for seed in range(3)]
    interval = over_runs(gaps)
    assert isinstance(interval, Interval) and interval.low > 0
