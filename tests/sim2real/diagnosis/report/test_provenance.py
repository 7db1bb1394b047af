"""What a report says of its making."""

import os
from pathlib import Path

import pytest

from sim2real.diagnosis.report.provenance import flat, sources


def test_words_are_written_apart_and_paths_are_kept() -> None:
    """A hash stands beside its log's own name, underscores and all."""
    tree = {"made_by": "me", "sha256": {"my_logs/run_1.csv": "abc"}, "exclude": []}
    assert flat(tree) == [
        ("made by", "me"),
        ("sha256: my_logs/run_1.csv", "abc"),
        ("exclude", "none"),
    ]


def test_paths_name_no_folder_that_nobody_typed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Below the working folder and the home folder they are relative; detours go."""
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setenv("HOME", str(tmp_path))
    inputs = {
        "logs": [str(tmp_path / "work" / "run" / "log.csv"), str(tmp_path / "other.csv")],
        "models": ["run/../../assets/arm.xml"],
    }
    away = os.path.join("..", "assets", "arm.xml")
    shown = [os.path.join("run", "log.csv"), os.path.join("~", "other.csv")]
    assert sources(inputs) == [f"'log=[{','.join(shown)}]'", f"model={away}"]
    assert flat(inputs) == [("logs", ", ".join(shown)), ("models", away)]
    hashes = {"sha256": dict.fromkeys(inputs["logs"], "abc")}
    assert flat(hashes) == [(f"sha256: {path}", "abc") for path in shown]
