"""The package as a stranger installs it: a wheel, without extras, away from the repository."""

import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).resolve().parent.parent
FLOOR = re.compile(r"([\w.-]+)>=([\w.]+)")


def floors() -> list[str]:
    """Return the lowest version of each dependency, as pip's constraints have it."""
    found = [FLOOR.match(line) for line in project()["dependencies"]]
    return [match.expand(r"\1==\2") for match in found if match]


def project() -> dict[str, Any]:
    """Return the project's table of pyproject.toml."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def run(*words: str | Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run a program that sees nothing of this checkout."""
    hidden = ("PYTHONPATH", "VIRTUAL_ENV")
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    command = [str(word) for word in words]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=1200, env=environment, cwd=cwd, check=False
    )


def succeed(*words: str | Path, cwd: Path | None = None) -> str:
    """Run a program that must succeed, and return what it printed."""
    done = run(*words, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done.stdout


def check_demo(out: Path) -> None:
    """Check that the demo's report names what its arm hides, and nothing else."""
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    hidden = yaml.safe_load((ROOT / "envs/assets/demo/answer.yaml").read_text(encoding="utf-8"))
    found = {(cause["effect"], cause["where"]) for cause in report["causes"]}
    assert report["verdict"] == "explained"
    assert found == {(entry["effect"], entry["where"]) for entry in hidden}


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build wheel and sdist, and return their folder."""
    if run(sys.executable, "-m", "pip", "index", "versions", "filelock").returncode:
        pytest.skip("no package index can be reached")
    folder = tmp_path_factory.mktemp("build")
    python = folder / "venv/bin/python"
    succeed(sys.executable, "-m", "venv", folder / "venv")
    succeed(python, "-m", "pip", "install", "hatchling")
    succeed(python, "-m", "hatchling", "build", "-d", folder / "dist", cwd=ROOT)
    return folder / "dist"


def wheel_of(dist: Path) -> Path:
    """Return the wheel."""
    (wheel,) = dist.glob("*.whl")
    return wheel


def interpreter(version: str) -> str:
    """Return a Python of a version; skip the test where there is none."""
    found = shutil.which(f"python{version}")
    if found is None or run(found, "--version").returncode:
        pytest.skip(f"there is no python{version}")
    return found


def test_every_dependency_has_a_floor() -> None:
    """And MuJoCo no upper bound that shuts out 4.0.1, which mends a fault of 4.0.0."""
    dependencies = project()["dependencies"]
    assert len(floors()) == len(dependencies)
    (engine,) = (line for line in dependencies if line.startswith("mujoco"))
    assert "4.0.1" in SpecifierSet(engine.removeprefix("mujoco"))


def test_the_citation_is_of_this_version() -> None:
    """CITATION.cff has the version of pyproject.toml, and the day of its release."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == project()["version"]
    assert citation["date-released"].year >= 2026


@pytest.mark.slow
@pytest.mark.timeout(2400)
def test_the_lowest_versions_diagnose_the_demo(dist: Path, tmp_path: Path) -> None:
    """They install together, without torch, and name what the arm of the demo hides."""
    constraints = tmp_path / "floors.txt"
    constraints.write_text("\n".join(floors()) + "\n", encoding="utf-8")
    succeed(sys.executable, "-m", "venv", tmp_path / "venv")
    python = tmp_path / "venv/bin/python"
    succeed(python, "-m", "pip", "install", "--constraint", constraints, wheel_of(dist))
    succeed(tmp_path / "venv/bin/sim2real", "+experiment=diagnose_demo", "out=run", cwd=tmp_path)
    check_demo(tmp_path / "run")


@pytest.mark.slow
@pytest.mark.timeout(2400)
@pytest.mark.parametrize("version", ["3.12", "3.13"])  # 3.11: the notebook, and the lowest versions
def test_the_wheel_runs_without_torch_and_repository(dist: Path, tmp_path, version: str) -> None:
    """The newest dependencies on newer Pythons run the demo, and its verdict is a plain table."""
    succeed(interpreter(version), "-m", "venv", tmp_path / "venv")
    python, program = tmp_path / "venv/bin/python", tmp_path / "venv/bin/sim2real"
    succeed(python, "-m", "pip", "install", wheel_of(dist))
    assert run(python, "-c", "import torch").returncode == 1
    assert succeed(program, "--version").split() == ["sim2real", project()["version"]]
    places = succeed(
        python, "-c", "import conf, envs, hardware; print(envs.__file__)", cwd=tmp_path
    )
    assert Path(places.strip()).is_relative_to(tmp_path)
    printed = succeed(program, "+experiment=diagnose_demo", "out=run", cwd=tmp_path)
    assert "Explained. " in printed and "\x1b" not in printed
    check_demo(tmp_path / "run")


@pytest.mark.slow
@pytest.mark.timeout(2400)
def test_one_command_runs_the_wheel_without_an_installation(dist: Path, tmp_path: Path) -> None:
    """By uvx, else by pipx: neither keeps an environment of the user's."""
    if uvx := shutil.which("uvx"):
        command = [uvx, "--from", wheel_of(dist)]
    elif pipx := shutil.which("pipx"):
        command = [pipx, "run", "--spec", wheel_of(dist)]
    else:
        pytest.skip("there is neither uvx nor pipx")
    succeed(*command, "sim2real", "+experiment=diagnose_demo", "out=run", cwd=tmp_path)
    check_demo(tmp_path / "run")


@pytest.mark.slow
def test_the_source_distribution_holds_what_the_tests_need(dist: Path) -> None:
    """Sources, tests, documentation and pins; nothing that a run or a build leaves."""
    (sdist,) = dist.glob("*.tar.gz")
    with tarfile.open(sdist) as file:
        names = {name.partition("/")[2] for name in file.getnames()}
    listed = set(succeed("git", "ls-files", cwd=ROOT).splitlines())
    assert names - listed == {"PKG-INFO"}
    assert {"pyproject.toml", "constraints.txt", "tests/test_install.py", "docs/index.md"} <= names


@pytest.mark.slow
@pytest.mark.timeout(2400)
def test_the_notebook_runs_in_an_empty_environment(dist: Path, tmp_path: Path, monkeypatch) -> None:
    """Its first cell installs the wheel; the report names what the arm of the demo hides."""
    nbclient = pytest.importorskip("nbclient", reason="notebooks need the extra 'notebooks'")
    nbformat = pytest.importorskip("nbformat", reason="notebooks need the extra 'notebooks'")
    succeed(sys.executable, "-m", "venv", tmp_path / "venv")
    python, work = tmp_path / "venv/bin/python", tmp_path / "work"
    succeed(python, "-m", "pip", "install", "ipykernel")
    assert run(python, "-c", "import numpy").returncode == 1
    work.mkdir()
    shutil.copy(wheel_of(dist), work)
    kernel = tmp_path / "jupyter/kernels/empty/kernel.json"
    kernel.parent.mkdir(parents=True)
    start = [str(python), "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    kernel.write_text(json.dumps({"argv": start, "display_name": "empty", "language": "python"}))
    monkeypatch.setenv("JUPYTER_PATH", str(tmp_path / "jupyter"))
    monkeypatch.delenv("PYTHONPATH", raising=False)
    notebook = nbformat.read(ROOT / "examples/diagnose_a_log.ipynb", as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert len(cells) == 5 and "%pip install" in cells[0].source
    assert not any(cell.outputs for cell in cells)
    client = nbclient.NotebookClient(
        notebook, timeout=1500, kernel_name="empty", resources={"metadata": {"path": str(work)}}
    )
    client.execute()
    check_demo(work)
    assert (work / "report.html").stat().st_size > 100_000
