"""The real arm's figures: errors over joints and logs, the share that closes, and the table."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks import so101
from benchmarks.so101 import ARM, FIT, HELD_OUT, closed, main, overall, report
from envs.effects import make, write_effects
from sim2real.runs.statistics import Interval


def test_nothing_is_held_out_that_was_fitted() -> None:
    """Fourteen logs, four of them fitted."""
    assert not set(FIT) & set(HELD_OUT)
    assert (len(FIT), len(HELD_OUT)) == (4, 10)


def test_what_is_closed() -> None:
    """From 5 to 2 over a floor of 1: three quarters, the same in every log."""
    before, after, floor = (np.full((6, 2), value) for value in (5.0, 2.0, 1.0))
    assert overall(np.array([[3.0, 4.0], [0.0, 5.0]])) == pytest.approx(np.sqrt(12.5))
    assert closed(before, after, floor) == pytest.approx((0.75, 0.75, 0.75))


def test_the_report_has_joints_causes_and_logs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Degrees, before and after, with what was found and what is left."""
    ones = np.ones((len(HELD_OUT), len(ARM)))
    parts = tuple(np.radians(value) * ones for value in (2.0, 0.6, 0.2))
    monkeypatch.setattr(so101, "replayed", lambda data, out: parts)
    cause = {"effect": "position_gain", "where": "elbow_flex", "value": 0.011, "unit": ""}
    cause |= {"value_ci": [0.01, 0.012], "closed": 0.7}
    answer = {"verdict": "partly_explained", "gap": {"before": 0.035, "after": 0.01}}
    answer |= {"causes": [cause], "unexplained": {"structure": "slow"}}
    folder = tmp_path / "diagnosis"
    folder.mkdir()
    write_effects(folder / "effects.yaml", [(make("position_gain", where="elbow_flex"), (0.011,))])
    (folder / "report.json").write_text(json.dumps(answer))
    table = report(tmp_path, tmp_path, tmp_path / "results")
    everything = table.rows[-1]
    assert everything[0] == "all five"
    assert everything[1:4] == pytest.approx((2.0, 0.6, 0.2))
    share = everything[4]
    assert isinstance(share, Interval)
    assert share.value == pytest.approx(1.4 / 1.8)
    page = (tmp_path / "results" / "so101.md").read_text()
    assert "What is left: slow." in page and "| position_gain | elbow_flex |" in page
    assert (tmp_path / "results" / "so101.png").is_file()


def test_without_logs_it_is_skipped(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It says where logs are, and fails nothing."""
    monkeypatch.delenv("SIM2REAL_DATA", raising=False)
    assert main([]) == 0
    assert "docs/logs.md" in capsys.readouterr().err
