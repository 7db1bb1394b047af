"""Tables say the same to a person in Markdown and to a program in CSV."""

import csv
from pathlib import Path

import pytest

from sim2real.runs.statistics import Interval
from sim2real.runs.tables import Table, format_cell


def table() -> Table:
    """Return a table with an interval, a bar in a name and a missing cell."""
    return Table(
        ("method", "return", "steps"),
        [("es|dr", Interval(1234.5678, 900.0, 1500.0), 20_000_000), ("plain", 12.5, None)],
        notes=["Intervals: 95 %."],
    )


def test_markdown_escapes_and_aligns() -> None:
    """A bar in a name does not split its cell, numbers stand right, notes follow."""
    assert table().markdown() == (
        "| method | return | steps |\n"
        "| --- | ---: | ---: |\n"
        "| es\\|dr | 1235 [900, 1500] | 20.0 M |\n"
        "| plain | 12.5 | – |\n"
        "\nIntervals: 95 %.\n"
    )


def test_csv_keeps_full_precision_and_splits_intervals(tmp_path: Path) -> None:
    """An interval fills three columns; a plain number beside it leaves two of them empty."""
    table().write(tmp_path / "deep" / "table", title="Results")
    with (tmp_path / "deep" / "table.csv").open(encoding="utf-8", newline="") as file:
        first, second = csv.DictReader(file)
    assert float(first["return"]) == 1234.5678
    assert (first["return_low"], first["return_high"]) == ("900.0", "1500.0")
    assert (second["return"], second["return_low"], second["steps"]) == ("12.5", "", "")
    assert (tmp_path / "deep" / "table.md").read_text(encoding="utf-8").startswith("# Results\n\n|")


def test_numbers_are_shown_with_the_digits_that_matter() -> None:
    """Whole from 100 up, one digit from 10, two below, millions shortened."""
    shown = [format_cell(x) for x in (403010, 1234.5, 99.94, 0.123, 3, 2.5e6, None, float("nan"))]
    assert shown == ["403,010", "1234", "99.9", "0.12", "3", "2.5 M", "–", "nan"]


def test_a_row_of_another_length_is_refused() -> None:
    """A missing cell would shift all that follow."""
    with pytest.raises(ValueError, match="2 cells in a table of 3 columns"):
        table().add("a", 1.0)
