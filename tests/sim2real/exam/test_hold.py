"""What all exams share."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from sim2real.exam import hold
from sim2real.exam.cases import Exam
from sim2real.exam.hold import Examiner
from sim2real.exam.inject import RealExam
from sim2real.exam.keyed import KeyedExam
from sim2real.exam.log_exam import LogExam
from sim2real.exam.thirdparty.exam import EngineExam
from sim2real.runs.tables import Table


@dataclass(frozen=True)
class Mark:
    """What became of a case."""

    case: str
    seconds: float


@pytest.mark.parametrize("kind", [Exam, RealExam, KeyedExam, LogExam, EngineExam])
def test_every_exam_is_reported(
    kind: type[Examiner], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In tables of its own, with how many cases were answered, and by which version."""
    figures = Table(("figure", "value"))
    figures.add("right", 1.0)
    mark = Mark("case_000", 36.0)
    monkeypatch.setattr(hold, "opened", lambda *_: (["case_000"], 2))
    monkeypatch.setattr(kind, "mark", lambda *_: mark)
    monkeypatch.setattr(kind, "summarize", lambda *_: {"table": ("Figures", figures)})
    assert object.__new__(kind).report(tmp_path, 2, 0) == [mark]
    text = (tmp_path / "table.md").read_text(encoding="utf-8")
    assert text.startswith(f"# {kind.title}\n\n**partial: true.** 1 of 2 cases of seed 0")
    assert "1 by unknown, in 0.01 hours" in text
    assert (tmp_path / "table.csv").is_file() and (tmp_path / "score.json").is_file()
