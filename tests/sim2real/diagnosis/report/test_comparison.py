"""Two diagnoses on one page: what is alike, what differs, what is new and what is gone."""

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest

from sim2real.diagnosis.report.comparison import read_report, render, view
from sim2real.diagnosis.schema import Cause, Report
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis.report.sample import report


def friction(where: str, value: float, spread: float) -> Cause:
    """Return friction of a joint with its interval."""
    ends = (value - spread, value + spread)
    return Cause("coulomb_friction", where, None, value, ends, "N·m", {}, 0.9, 0.5)


def with_causes(*causes: Cause) -> Report:
    """Return a report of these causes."""
    return replace(report(), causes=causes)


EARLIER = with_causes(friction("elbow", 0.02, 0.002), friction("wrist", 0.01, 0.001))


def test_values_are_set_beside_each_other() -> None:
    """Intervals that overlap are alike, others differ; an effect may be in one of the two alone."""
    later = with_causes(
        friction("elbow", 0.021, 0.002), friction("wrist", 0.015, 0.001), friction("hip", 1.0, 0.1)
    )
    seen = view(EARLIER, later)
    verdicts = {row["name"].split(" at ")[1]: row["verdict"] for row in seen["causes"]}
    assert verdicts == {"elbow": "alike", "wrist": "differs", "hip": "new"}
    assert seen["summary"].startswith("Found only later: ") and "another value" in seen["summary"]
    elbow = render(EARLIER, later).partition("riction at elbow</th>")[2].partition("</tr>")[0]
    values = re.findall(r'<td class="num">(.*?)<small>', elbow)
    assert values == ["20.0\u00a0mN·m", "21.0\u00a0mN·m"]
    assert view(later, EARLIER)["causes"][2]["verdict"] == "gone"
    assert "both find the same" in view(EARLIER, EARLIER)["summary"].lower()


def test_the_page_is_one_file_without_links() -> None:
    """Names of joints are text, whatever they hold."""
    evil = "<script>alert(1)</script>"
    page = render(EARLIER, with_causes(friction(evil, 0.02, 0.002)))
    assert evil not in page and "&lt;script&gt;alert(1)" in page
    assert "http://" not in page and "https://" not in page
    assert "20.0\u00a0mN·m" in page and "not found" in page


def test_a_report_is_found_by_its_folder(tmp_path: Path) -> None:
    """Or by its file; what is no report is refused with the path."""
    EARLIER.write(tmp_path / "report.json")
    assert read_report(tmp_path) == read_report(tmp_path / "report.json")
    assert read_report(tmp_path).causes[0].value == 0.02
    written = report().save_comparison(tmp_path / "comparison.html", read_report(tmp_path))
    assert "oulomb friction at elbow" in written.read_text(encoding="utf-8")
    with pytest.raises(Sim2RealError, match="gone: No such file"):
        read_report(tmp_path / "gone")
    (tmp_path / "report.json").write_text(json.dumps([1]))
    with pytest.raises(Sim2RealError, match="not a report of a diagnosis"):
        read_report(tmp_path)
