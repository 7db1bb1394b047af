"""The prior odds of a missing law, from the answers of exams."""

from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from benchmarks import confidence


@pytest.mark.parametrize("times", [0.05, 1.0, 4.0])
def test_the_fit_finds_the_prior_odds_that_drew_the_answers(times: float) -> None:
    """Answers that are right as often as their odds over the prior ones say."""
    rng = np.random.default_rng(0)
    odds = rng.uniform(-3.0, 3.0, 20_000)
    right = (rng.random(len(odds)) < expit(odds - np.log(times))).astype(float)
    assert confidence.fit(expit(odds), right) == pytest.approx(times, rel=0.1)


def test_scored_exams_are_read(tmp_path: Path) -> None:
    """Answers without a cause, and to cases that hide nothing, say nothing."""
    rows = [
        "case,kind,confidence,right",
        "case_000,single,0.9,1.0",
        "case_001,single,,",
        "case_002,dirty,1.0,0.0",
        "case_003,off_nominal,0.7,0.0",
    ]
    table = tmp_path / "cases.csv"
    table.write_text("\n".join(rows) + "\n", encoding="utf-8")
    said, right = confidence.read([table, table])
    assert said.tolist() == [0.9, 1.0, 0.9, 1.0]
    assert right.tolist() == [1.0, 0.0, 1.0, 0.0]
    assert "Calibration error" in confidence.table(said, right).markdown()
