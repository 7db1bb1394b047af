"""Answers that are called explained are counted from the tables of exams."""

from pathlib import Path

import pytest

from benchmarks import explained
from benchmarks.explained import Answer, main, read

HEAD = "case,kind,answer,rank1"
ROWS = (
    "case_000,one,explained: armature at hip 0.1 = link_inertia@hip,1",
    "case_001,excluded,explained: link_mass at hip 0.2; armature at hip 0.1,",
    "case_002,two,explained: backlash at hip (link) 0.02; command_delay 0.01,1",
    "case_003,two,partly_explained: link_mass at hip 0.2; armature at hip 0.1,0",
    "case_004,two,explained: gravity_tilt 0.1 0.2; command_delay 0.01,0",
    "case_005,none,no_gap,",
)


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """A table of six answers, four of which are called explained."""
    path = tmp_path / "thirdparty_9.csv"
    path.write_text("\n".join((HEAD, *ROWS)) + "\n", encoding="utf-8")
    return path


def test_what_is_called_explained_is_read(table: Path) -> None:
    """An effect withheld and nothing hidden have no rank: explained is wrong there."""
    assert read(table) == [Answer(table.name, right) for right in (True, False, True, False)]


def test_the_page_counts_tables(table: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The calibration half is no sealed draw."""
    (table.parent / explained.CALIBRATION).write_text(f"{HEAD}\n{ROWS[0]}\n", encoding="utf-8")
    assert main(["--results", str(table.parent)]) == 0
    text = (table.parent / "explained.md").read_text(encoding="utf-8")
    assert text.strip() == capsys.readouterr().out.strip()
    assert "| **another engine** | 5 | 3 | 0.60" in text
    assert "| **another engine, sealed draws** | 4 | 2 | 0.50" in text


def test_a_folder_without_tables_is_refused(tmp_path: Path, capsys) -> None:
    """It says which folder, and what is missing in it."""
    with pytest.raises(SystemExit):
        main(["--results", str(tmp_path)])
    assert f"{tmp_path}: no blindcheck*.csv or thirdparty*.csv" in capsys.readouterr().err
