"""An answer is there as soon as there is a verdict."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import pytest

from sim2real.diagnosis import diagnose
from sim2real.diagnosis.outcome import Diagnosis
from sim2real.diagnosis.schema import GapMetrics, Report, Unexplained
from sim2real.exam.answer import EFFECTS, ERROR, REPORT, TASK, answer
from tests.sim2real.diagnosis import arm


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    """Return the folder of a case."""
    folder = tmp_path / "logs"
    folder.mkdir()
    log = arm.make_log(seconds=2.0)
    (folder / "a.csv").write_text(
        "\n".join(
            [
                ",".join(log.columns),
                *(",".join(map(str, row)) for row in zip(*log.columns.values(), strict=True)),
            ]
        )
    )
    (folder / TASK).write_text(json.dumps({"effects": None, "exclude": [], "seed": 0}))
    return folder


def verdict(name: str, seconds: float) -> Diagnosis:
    """Return a diagnosis without causes."""
    gap = GapMetrics("rad", 0.01, 0.01, 0.001, 0.0, (0.0, 0.0), True)
    report = Report(name, gap, (), (), Unexplained(1.0, "none"), seconds=seconds)  # type: ignore[arg-type]
    return Diagnosis(report, (), mujoco.MjSpec(), (), ())


def test_a_case_whose_time_is_over_after_the_verdict_has_its_answer(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What comes after a verdict may take longer than an exam allows; it is ended then."""

    def ended(*given: Any, on_verdict: Callable[[Diagnosis], None]) -> Diagnosis:
        on_verdict(verdict("unexplained", 3.0))
        raise KeyboardInterrupt

    monkeypatch.setattr(diagnose, "run_diagnosis", ended)
    folder = tmp_path / "answer"
    folder.mkdir()
    with pytest.raises(KeyboardInterrupt):
        answer(logs, folder)
    assert json.loads((folder / REPORT).read_text())["verdict"] == "unexplained"
    assert (folder / EFFECTS).is_file() and not (folder / ERROR).is_file()


def test_the_whole_answer_takes_the_place_of_the_first(logs: Path, tmp_path, monkeypatch) -> None:
    """A cause that is only numerics leaves the files once it is known."""

    def whole(*given: Any, on_verdict: Callable[[Diagnosis], None]) -> Diagnosis:
        on_verdict(verdict("unexplained", 3.0))
        return verdict("unexplained", 5.0)

    monkeypatch.setattr(diagnose, "run_diagnosis", whole)
    answer(logs, tmp_path / "answer")
    assert json.loads((tmp_path / "answer" / REPORT).read_text())["seconds"] == 5.0
