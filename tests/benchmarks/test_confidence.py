"""The curve of a cause's confidence: fitted, judged, and the one that the diagnosis has."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import confidence
from benchmarks.confidence import Answer
from sim2real.diagnosis.attribution.alike import calibrated
from sim2real.diagnosis.settings import DEFAULT


def drawn(count: int, curve: tuple[float, float]) -> list[Answer]:
    """Return answers that are right as often as a curve says."""
    rng = np.random.default_rng(0)
    closed, races = rng.uniform(0.3, 0.98, count), rng.uniform(0.7, 1.0, count)
    chance = confidence.confidence(races, 1 - closed, curve)
    right = (rng.random(count) < chance).astype(int)
    rows = zip(races, closed, right, strict=True)
    return [Answer("drawn", f"case_{i}", "single", *row) for i, row in enumerate(rows)]


def test_the_fit_finds_the_curve_that_drew_the_answers() -> None:
    """And its confidences, each answer left out of its own curve, are as good as said."""
    found = confidence.fit(drawn(4000, (-2.0, 1.8)))
    assert found == pytest.approx((-2.0, 1.8), abs=0.25)
    answers = drawn(60, (-2.0, 1.8))
    assert len(confidence.left_out(answers)) == 60
    assert "60 answers" in confidence.table(answers).markdown()


def test_the_diagnosis_has_the_curve_of_the_kept_answers() -> None:
    """To the digits that are printed."""
    found = confidence.fit(confidence.read(confidence.RESULTS))
    assert found == pytest.approx(DEFAULT.causes.calibration, abs=0.01)


def test_a_scored_exam_is_read(tmp_path: Path) -> None:
    """What its races said is the confidence over the curve; answers without a cause are not."""
    said = calibrated(0.9, 0.95, DEFAULT.causes)
    reports = {"case_000": [{"confidence": said}], "case_001": [], "case_002": [{"confidence": 1}]}
    for case, causes in reports.items():
        (tmp_path / "answers" / case).mkdir(parents=True)
        text = json.dumps({"causes": causes, "gap": {"closed": 0.95}})
        (tmp_path / "answers" / case / "report.json").write_text(text, encoding="utf-8")
    rows = "case,kind,right\ncase_000,single,1.0\ncase_001,single,\ncase_002,dirty,0.0\n"
    (tmp_path / "cases.csv").write_text(rows, encoding="utf-8")
    first, second = confidence.answers_of(tmp_path, "new")
    assert first == ("new", "case_000", "single", pytest.approx(0.9, abs=1e-6), 0.95, 1)
    assert second.races == 1.0 and second.right == 0
