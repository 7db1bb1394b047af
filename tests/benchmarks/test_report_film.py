"""The moving picture of a report: what it shows, and what it refuses."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import report_film
from sim2real.diagnosis.report.html import render
from tests.sim2real.diagnosis.conftest import browser as browser  # a fixture
from tests.sim2real.diagnosis.report.test_browser import sample


def test_the_cursor_passes_twice() -> None:
    """The top, then the model as given, then the corrected one, over the same moments."""
    top, *rest = report_film.shots()
    first, second = rest[: report_film.STEPS], rest[report_film.STEPS :]
    assert top.at is None
    assert [s.at for s in first] == [s.at for s in second]
    assert {s.corrected for s in first} == {False} and {s.corrected for s in second} == {True}


def test_a_report_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The error names the file, or the browser that is missing."""
    with pytest.raises(SystemExit):
        report_film.main([str(tmp_path / "none.html"), str(tmp_path / "film.gif")])
    said = capsys.readouterr().err
    assert "none.html: there is no such file" in said or "no browser found" in said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.render
def test_pictures_show_the_cursor_and_the_switch(browser: str, tmp_path: Path) -> None:
    """Another moment is another picture, and so is the model without causes."""
    text = render(sample())
    shots = [report_film.Shot(0.3), report_film.Shot(0.7), report_film.Shot(0.3, corrected=False)]
    seen = [np.asarray(report_film.shoot(browser, text, shot, tmp_path)) for shot in shots]
    assert all(picture.std() > 1 for picture in seen)  # not blank
    assert (seen[0] != seen[1]).any() and (seen[0] != seen[2]).any()
