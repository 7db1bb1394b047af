"""The temperature of a diagnosis's confidence, from the answers of an exam."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from benchmarks import confidence


@pytest.mark.parametrize("times", [0.5, 1.0, 4.0])
def test_the_fit_finds_the_temperature_that_drew_the_answers(times: float) -> None:
    """Answers that are right as often as their log odds over it say."""
    rng = np.random.default_rng(0)
    odds = rng.uniform(-1.0, 5.0, 20_000)
    right = (rng.random(len(odds)) < expit(odds / times)).astype(float)
    assert confidence.fit(expit(odds), right) == pytest.approx(times, rel=0.1)


def test_a_scored_exam_is_read(tmp_path: Path) -> None:
    """Answers without a cause say nothing."""
    reports = {"case_000": [{"confidence": 0.9}], "case_001": [], "case_002": [{"confidence": 1}]}
    for case, causes in reports.items():
        (tmp_path / "answers" / case).mkdir(parents=True)
        text = json.dumps({"causes": causes})
        (tmp_path / "answers" / case / "report.json").write_text(text, encoding="utf-8")
    rows = "case,kind,right\ncase_000,single,1.0\ncase_001,single,\ncase_002,dirty,0.0\n"
    (tmp_path / "cases.csv").write_text(rows, encoding="utf-8")
    said, right = confidence.read(tmp_path)
    assert said.tolist() == [0.9, 1.0]
    assert right.tolist() == [1.0, 0.0]
    assert "Calibration error" in confidence.table(said, right).markdown()
