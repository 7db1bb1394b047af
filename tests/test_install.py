"""The package as a stranger installs it: without extras, with the lowest versions that it names."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).resolve().parent.parent
FLOOR = re.compile(r"([\w.-]+)>=([\w.]+)")


def floors() -> list[str]:
    """Return the lowest version of each dependency, as pip's constraints have it."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    found = [FLOOR.match(line) for line in tomllib.loads(text)["project"]["dependencies"]]
    return [match.expand(r"\1==\2") for match in found if match]


def run(*words: str | Path, timeout: float = 1200) -> subprocess.CompletedProcess[str]:
    """Run a program that sees nothing of this checkout."""
    hidden = ("PYTHONPATH", "VIRTUAL_ENV")
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    return subprocess.run(
        [str(word) for word in words],
        capture_output=True,
        text=True,
        timeout=timeout,
        env=environment,
        check=False,
    )


def test_every_dependency_has_a_floor() -> None:
    """And MuJoCo no upper bound that shuts out 4.0.1, which mends a fault of 4.0.0."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert len(floors()) == len(project["dependencies"])
    (engine,) = (line for line in project["dependencies"] if line.startswith("mujoco"))
    assert "4.0.1" in SpecifierSet(engine.removeprefix("mujoco"))


@pytest.mark.slow
@pytest.mark.timeout(2400)
def test_the_lowest_versions_diagnose_the_demo(tmp_path: Path) -> None:
    """They install together, without torch, and name what the arm of the demo hides."""
    if run(sys.executable, "-m", "pip", "index", "versions", "filelock").returncode:
        pytest.skip("no package index can be reached")
    constraints = tmp_path / "floors.txt"
    constraints.write_text("\n".join(floors()) + "\n", encoding="utf-8")
    assert run(sys.executable, "-m", "venv", tmp_path / "venv").returncode == 0
    python, out = tmp_path / "venv/bin/python", tmp_path / "run"
    made = run(python, "-m", "pip", "install", "--constraint", constraints, ROOT)
    assert made.returncode == 0, made.stderr
    assert run(python, "-c", "import torch").returncode == 1
    program = tmp_path / "venv/bin/sim2real"
    done = run(program, "+experiment=diagnose_demo", f"hydra.run.dir={out}")
    assert done.returncode == 0, done.stderr
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    hidden = yaml.safe_load((ROOT / "envs/assets/demo/answer.yaml").read_text(encoding="utf-8"))
    found = {(cause["effect"], cause["where"]) for cause in report["causes"]}
    assert report["verdict"] == "explained"
    assert found == {(entry["effect"], entry["where"]) for entry in hidden}
