"""The tutorials run from their first cell to the last, in an empty folder."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = [  # those that are notebooks
    page
    for page in sorted((ROOT / "docs" / "tutorials").glob("*.md"))
    if "  jupytext:\n" in page.read_text(encoding="utf-8")
]


def test_there_are_tutorials() -> None:
    """Each is on the site's list, and its cells are Python."""
    listed = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert len(PAGES) == 3
    for page in PAGES:
        assert f"tutorials/{page.name}" in listed
        assert page.read_text(encoding="utf-8").count("```python") >= 4


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_tutorial_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every cell, with the assertions that it makes itself."""
    jupytext = pytest.importorskip("jupytext", reason="notebooks need the extra 'notebooks'")
    nbclient = pytest.importorskip("nbclient", reason="notebooks need the extra 'notebooks'")
    pytest.importorskip("ipykernel", reason="notebooks need the extra 'notebooks'")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    notebook = jupytext.read(page)
    resources = {"metadata": {"path": str(tmp_path)}}
    client = nbclient.NotebookClient(
        notebook, timeout=1500, kernel_name="python3", resources=resources
    )
    client.execute()
    assert list(tmp_path.iterdir()), "the tutorial left nothing behind"
