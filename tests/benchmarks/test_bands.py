"""The benchmark of bands: what is held out, and what is not repeated."""

from collections import Counter
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from benchmarks import bands, so101, xl330
from benchmarks.cases import read_csv
from envs.distribution import Distribution
from sim2real.identification.methods.base import FitContext
from sim2real.identification.methods.matching import Matching
from tests.sim2real.identification.linear import PRIOR, Linear


def test_every_log_is_held_out_once() -> None:
    """Twelve logs in four folds, and never in both parts."""
    splits = bands.folds(12)
    assert Counter(k for _, held in splits for k in held) == dict.fromkeys(range(12), 1)
    assert all(len(held) == 3 and not set(held) & set(fitted) for fitted, held in splits)
    assert splits[0][1] != [0, 1, 2]


def test_a_distribution_is_of_its_logs_and_read_again(tmp_path: Path, monkeypatch) -> None:
    """Two robots: the distribution is that of the one whose logs are given."""
    rng = np.random.default_rng(0)
    values = np.repeat([[1.0, -2.0], [3.0, 2.0]], 4, axis=0)
    made, path = Linear(values, 0.05, rng), tmp_path / "bands" / "distribution_0.yaml"
    found = bands.identified(made, PRIOR, [4, 5, 6], 0, path)
    assert found.mean == pytest.approx([3.0, 2.0], abs=0.05)
    asked: list[FitContext] = []

    def fit(self: Matching, provider: Linear, prior: Distribution, run: FitContext) -> Distribution:
        asked.append(run)
        return prior

    monkeypatch.setattr(Matching, "found", fit)
    again = bands.identified(made, PRIOR, [4, 5, 6], 0, path)
    assert not asked
    np.testing.assert_allclose(again.mean, found.mean)


def test_a_robot_s_rows_are_replaced_and_the_others_stay(tmp_path: Path) -> None:
    """The table has a line a robot, its means with intervals over logs."""
    ends = {"before": "9.0", "after": "2.0", "crps": "1.0", "absolute": "1.5"}
    rows = [
        {"robot": robot, "log": f"log{k}", "fold": "0", **ends, "coverage": f"{0.8 + 0.1 * k}"}
        for robot in ("so101", "xl330")
        for k in range(2)
    ]
    bands.keep(rows, tmp_path)
    assert read_csv(tmp_path / "bands.csv") == rows
    text = (tmp_path / "bands.md").read_text(encoding="utf-8")
    assert "| xl330 | 2 | 9" in text and "0.85 [0.80, 0.90]" in text


def test_without_the_logs_it_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing is written."""
    assert bands.main(["xl330", "--data", str(tmp_path), "--results", str(tmp_path)]) == 0
    assert "skipped" in capsys.readouterr().out and not list(tmp_path.iterdir())


@pytest.mark.parametrize("bench", [so101, xl330], ids=["so101", "xl330"])
def test_without_logs_a_benchmark_is_skipped(bench: ModuleType, capsys, monkeypatch) -> None:
    """It says where logs are, and fails nothing."""
    monkeypatch.delenv("SIM2REAL_DATA", raising=False)
    assert bench.main([]) == 0
    assert "docs/explanation/evidence.md" in capsys.readouterr().err
