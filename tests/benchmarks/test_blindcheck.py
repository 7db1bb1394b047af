"""The exam as a long comparison: it resumes in its own folder and keeps what people read."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from benchmarks import blindcheck


def test_it_goes_on_in_its_folder_and_keeps_the_tables(tmp_path: Path, monkeypatch) -> None:
    """The folder is the one that it resumes; table, cases and picture land in the results."""
    commands = []

    def run(command: list[str]) -> SimpleNamespace:
        commands.append(command)
        folder = Path(command[-1].removeprefix("resume="))
        for name in blindcheck.KEPT:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(name)
        return SimpleNamespace(returncode=0)

    monkeypatch.setattr(blindcheck.subprocess, "run", run)
    out, results = tmp_path / "out", tmp_path / "results"
    chosen = ["--experiments", "blindcheck_small", "--out", str(out), "--results", str(results)]
    assert blindcheck.main(chosen) == 0
    folder = out / "blindcheck_small"
    assert commands[0][-2:] == [f"hydra.run.dir={folder}", f"resume={folder}"]
    assert (results / "blindcheck_small.md").read_text() == "table.md"
    assert (results / "blindcheck_small.png").is_file()


def test_several_programs_share_an_exam(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All get the same line; a part is asked for in it; one that fails is told."""
    lines, codes = [], iter((0, 3))

    class Helper:
        def __init__(self, command: list[str]) -> None:
            lines.append(command)

        def wait(self) -> int:
            return next(codes)

    def run(command: list[str]) -> SimpleNamespace:
        lines.append(command)
        return SimpleNamespace(returncode=0)

    monkeypatch.setattr(blindcheck.subprocess, "Popen", Helper)
    monkeypatch.setattr(blindcheck.subprocess, "run", run)
    assert blindcheck.hold("blindcheck", tmp_path, tmp_path / "kept", 3, 5) == 3
    assert len(lines) == 3 and all(line == lines[0] for line in lines)
    assert lines[0][-1] == "exam.most=5"


def test_a_failed_exam_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is kept of it."""
    failed = SimpleNamespace(returncode=2)
    monkeypatch.setattr(blindcheck.subprocess, "run", lambda command: failed)
    assert blindcheck.main(["--out", str(tmp_path), "--results", str(tmp_path / "kept")]) == 1
    assert not (tmp_path / "kept").exists()


def test_real_logs_are_asked_for_only_where_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without SIM2REAL_DATA the exam on real logs is left out."""
    monkeypatch.delenv("SIM2REAL_DATA", raising=False)
    assert blindcheck.default_experiments() == ["blindcheck"]
    monkeypatch.setenv("SIM2REAL_DATA", "data")
    assert blindcheck.default_experiments() == ["blindcheck", "blindcheck_real"]
