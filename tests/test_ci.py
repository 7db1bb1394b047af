"""What continuous integration runs: the same commands here and on GitHub, on every Python named."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))
MAKE = re.compile(r"^(?:exec )?make ([a-z-]+)$", re.MULTILINE)


def job() -> dict[str, Any]:
    """Return the job of the workflow."""
    text = (ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8")
    return yaml.safe_load(text)["jobs"]["test"]


def test_the_workflow_runs_what_ci_runs() -> None:
    """The linters, then the suite, as `.ci/run` does after the setup that both start with."""
    here = MAKE.findall((ROOT / ".ci/run").read_text(encoding="utf-8"))
    there = [found for step in job()["steps"] for found in MAKE.findall(step.get("run", ""))]
    assert here == ["setup", "lint", "test"]
    assert there == here[1:]


def test_the_workflow_runs_every_python_that_is_promised() -> None:
    """From the oldest that `requires-python` lets in; each that a classifier names."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    versions = job()["strategy"]["matrix"]["python"]
    assert versions[0] == project["requires-python"].removeprefix(">=")
    named = re.findall(r":: Python :: (3\.\d+)", "\n".join(project["classifiers"]))
    assert set(named) <= set(versions)


def test_the_documentation_is_published_with_its_sample_reports() -> None:
    """Built by `make docs` into the folder that mkdocs.yml names, and each sample is checked."""
    text = (ROOT / ".github/workflows/docs.yml").read_text(encoding="utf-8")
    build, deploy = yaml.safe_load(text)["jobs"].values()
    commands = "\n".join(step.get("run", "") for step in build["steps"])
    assert MAKE.findall(commands) == ["docs"]
    site = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    (folder,) = re.findall(r"^site_dir: (.+)$", site, re.MULTILINE)
    (upload,) = (step for step in build["steps"] if "upload-pages" in step.get("uses", ""))
    assert upload["with"]["path"] == folder
    samples = {path.name for path in (ROOT / "docs/samples").glob("*.html")}
    assert set(re.findall(rf"{folder}/samples/(\S+\.html)", commands)) == samples
    assert deploy["needs"] == "build"


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_may_do_little_and_run_pinned_actions(path: Path) -> None:
    """Each reads the repository at most unless a job says more, and names actions by their hash."""
    workflow = yaml.safe_load(path.read_text(encoding="utf-8"))
    assert workflow["permissions"] == {"contents": "read"}
    for one in workflow["jobs"].values():
        assert one["timeout-minutes"] <= 90
        for step in one["steps"]:
            assert re.fullmatch(r"[\w./-]+@[0-9a-f]{40}", step.get("uses", f"a@{'0' * 40}"))


def test_hooks_need_nothing_from_elsewhere() -> None:
    """Each hook is local and runs what the setup installed."""
    text = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    for source in yaml.safe_load(text)["repos"]:
        assert source["repo"] == "local"
        for hook in source["hooks"]:
            assert hook["language"] == "system" and hook["entry"].startswith(".venv/bin/")
