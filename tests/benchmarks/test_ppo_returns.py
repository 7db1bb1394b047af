"""The comparison of returns counts what it says."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from benchmarks import ppo_returns
from benchmarks.ppo_returns import KINDS, Curve, GymRows, mark, read, report, run, time_to
from envs import Hopper, HopperPolito, Simulation


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Give the comparison an empty folder."""
    monkeypatch.setattr(ppo_returns, "RESULTS", tmp_path)
    return tmp_path


def curve(path: Path, returns: list[float], seconds: float) -> None:
    """Write a curve of a point a second."""
    made = Curve()
    made.rows = [(2048 * (i + 1), r, seconds * (i + 1), 0.0) for i, r in enumerate(returns)]
    made.write(path)


def test_a_seed_that_never_gets_there_counts(results: Path) -> None:
    """The mark is the median end; the median of times holds infinities; the ratio is told."""
    for seed, end in enumerate((500.0, 900.0, 1500.0)):
        curve(KINDS[0].file(seed), [100.0, end], 10.0)
    for seed, ends in enumerate(([950.0], [300.0, 400.0], [200.0, 1000.0])):
        curve(KINDS[1].file(seed), ends, 1.0)
    assert mark() == 900.0
    times = [time_to(read(path), 900.0) for path in KINDS[1].files()]
    assert times == [1.0, float("inf"), 2.0]
    report()
    text = (results / "time_to_return.md").read_text()
    assert "return of 900" in text and "1, never, 2" in text
    assert "Ratio of the medians: 10.0" in text  # 20 s of sb3 (never, 20, 20) by 2 s
    assert (results / "hopper.png").stat().st_size > 1000


def test_equal_groups_are_told_alike(results: Path) -> None:
    """Two groups of the same returns: a half, and an interval that contains it."""
    for kind in KINDS[2:]:
        for seed in range(10):
            curve(kind.file(seed), [100.0 * (seed + 1)], 1.0)
    report()
    text = (results / "alike.md").read_text()
    assert "= 0.50" in text and "which contains 0.5" in text


def test_a_row_as_gymnasium_is_the_row() -> None:
    """Rewards and ends through the adapter are those of the simulation; the limit is no end."""
    env = GymRows(Simulation(HopperPolito(max_steps=8), 1, threads=1), seed=3)
    rows = Simulation(HopperPolito(max_steps=8), 1, threads=1)
    seed = np.random.default_rng(3).integers(0, 2**63, 1).astype(np.uint64)
    observation, _ = env.reset()
    ids = np.zeros(1, np.int64)
    np.testing.assert_array_equal(observation, rows.reset(ids, np.zeros((1, 0)), seed)[0])
    for count in range(8):
        action = np.full(3, 0.1, np.float32)
        seen, reward, over, cut, _ = env.step(action)
        step = rows.step(None, action[None].astype(np.float64))
        np.testing.assert_array_equal(seen, step.observation[0])
        assert reward == step.reward[0] and not over and cut == (count == 7)


@pytest.mark.usefixtures("results")
@pytest.mark.skipif(not find_spec("stable_baselines3"), reason="needs stable-baselines3")
@pytest.mark.slow
def test_both_leave_curves_of_their_steps() -> None:
    """A run of each, one iteration long, writes its steps; it is not repeated."""
    for kind in (KINDS[2], KINDS[3]):
        short = replace(kind, steps=2048)
        run(short, 0)
        before = short.file(0).stat().st_mtime_ns
        assert read(short.file(0))[0].tolist() == [2048.0]
        run(short, 0)
        assert short.file(0).stat().st_mtime_ns == before
    assert type(KINDS[0].task()) is Hopper
