"""manifest.json says with what, from what and on what a run was made."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sim2real.runs.manifest import command_line, git, write_manifest


def test_manifest_says_how_a_run_was_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seed, command line, versions and machine are in it, and no other file is left beside it."""
    monkeypatch.setattr(sys, "argv", ["/some/where/sim2real", "seed=4"])
    manifest = json.loads(write_manifest(tmp_path / "run", seed=4).read_text())
    assert (manifest["seed"], manifest["argv"]) == (4, ["sim2real", "seed=4"])
    assert manifest["packages"]["numpy"] == np.__version__
    assert manifest["machine"]["cores"] >= 1
    assert manifest["machine"]["memory"] > 2**28
    assert [path.name for path in (tmp_path / "run").iterdir()] == ["manifest.json"]


def test_the_command_can_be_given_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is quoted for a shell; a folder that no command made has none."""
    assert command_line(tmp_path) is None
    for program, start in (
        ("/a/bin/sim2real", "sim2real"),
        ("x/__main__.py", "python -m sim2real"),
    ):
        monkeypatch.setattr(sys, "argv", [program, "run=diagnose", "log=my arm.csv"])
        write_manifest(tmp_path, seed=0)
        assert command_line(tmp_path) == f"{start} run=diagnose 'log=my arm.csv'"


def test_git_revision_and_dirty_flag(tmp_path: Path) -> None:
    """In a checkout the revision is named and a change is seen; elsewhere there is none."""
    assert git(tmp_path) is None

    def run(*arguments: str) -> str:
        command = [
            "git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b.c", *arguments,
        ]  # fmt: skip
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    run("init", "-q")
    (tmp_path / "file").write_text("one")
    run("add", "file")
    run("commit", "-qm", "first")
    assert git(tmp_path) == {"revision": run("rev-parse", "HEAD"), "dirty": False}
    (tmp_path / "file").write_text("two")
    assert git(tmp_path) == {"revision": run("rev-parse", "HEAD"), "dirty": True}
