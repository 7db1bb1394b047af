"""Fresh exams of one likelihood are counted together."""

from pathlib import Path

import pytest

from benchmarks.likelihood import EXAMS, main

HEAD = "case,kind,answer,rank1,alarm,covered"
OWN_ROWS = (
    "case_000,one,explained: backlash at hip 0.1,1,,1",
    "case_001,two,unexplained,0,,",
    "case_002,none,no_gap,,0,",
    "case_003,excluded,explained: link_mass at hip 0.2,,,",
)
OTHER_ROWS = (
    "case_000,single,explained: armature at hip 0.1,1,,0",
    "case_001,dirty,no_gap,0,,",
    "case_002,outside,unexplained,,,",
)
MISTAKES = "case,named,blamed\ncase_000,1,0\ncase_001,0,1\ncase_002,1,0\n"


def test_each_question_is_asked_of_its_cases(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An answer that is not called explained counts for no question about such answers."""
    for own, other, mistakes, real in EXAMS.values():
        for name in mistakes:
            (tmp_path / name).write_text(MISTAKES, encoding="utf-8")
        for names, rows in ((own, OWN_ROWS), (other, OTHER_ROWS), (real, OTHER_ROWS[:2])):
            for name in names:
                (tmp_path / name).write_text("\n".join((HEAD, *rows)) + "\n", encoding="utf-8")
    assert main(["--results", str(tmp_path)]) == 0
    text = (tmp_path / "likelihood.md").read_text(encoding="utf-8")
    assert text.strip() == capsys.readouterr().out.strip()
    for own, other, mistakes, real in EXAMS.values():
        n, m, k = len(own), len(other), len(mistakes)
        assert f"| mistake in a log named | {3 * k} | {2 * k} | 0.67" in text
        assert f"called an effect | {3 * k} | {k} | 0.33" in text
        assert not real or f"real log named first | {2 * len(real)} | {len(real)} | 0.50" in text
        assert f"| hidden effect named first | {2 * n} | {n} | 0.50" in text
        assert f"| healthy robot blamed | {n} | 0 | 0.00" in text
        assert f"is excluded | {n} | {n} | 1.00" in text
        assert f"90 % interval | {n} | {n} | 1.00" in text
        assert f"explained` and right | {m} | {m} | 1.00" in text
        assert f"of the library acts | {m} | 0 | 0.00" in text


def test_a_folder_without_the_tables_is_refused(tmp_path: Path) -> None:
    """Which are missing is said."""
    with pytest.raises(SystemExit):
        main(["--results", str(tmp_path)])
