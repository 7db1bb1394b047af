"""Recordings in the page: what is packed comes back, and lines are named by their causes."""

import base64
from typing import Any

import numpy as np
import pytest

from sim2real.diagnosis.evidence import Evidence, Signal, Trace
from sim2real.diagnosis.report.recordings import NOTHING, floats, packed, recordings
from sim2real.diagnosis.schema import GapMetrics, JointGap, Report, Unexplained


def unpacked(line: dict[str, Any]) -> np.ndarray:
    """Return numbers as the page's script reads them."""
    counts = np.frombuffer(base64.b64decode(line["counts"]), "<u2")
    return np.where(counts == NOTHING, np.nan, line["low"] + line["step"] * counts)


def trace(joint: str, subsets: int = 2) -> Trace:
    """Return a second of a joint with all subsets of so many causes."""
    time = np.arange(0, 1, 0.01)
    every = [frozenset(i for i in range(subsets) if n >> i & 1) for n in range(2**subsets)]
    lines = {some: np.sin(time) + 0.1 * (subsets - len(some)) for some in every}
    ends = lines[frozenset()], lines[frozenset(range(subsets))]
    starts = np.array([0, 50])
    return Trace("a.csv", 0, joint, "rad", time, np.sin(time), *ends, 0.001, starts, lines)


def test_numbers_come_back_within_half_a_step() -> None:
    """Values to a part in 65,000 of their range; what is unknown stays unknown."""
    values = np.array([-1.0, np.nan, 0.123456, 2.0])
    again = unpacked(packed(values))
    assert np.isnan(again[1])
    np.testing.assert_allclose(again, values, atol=3.0 / 65_000)
    assert unpacked(packed(np.full(3, 7.0))).tolist() == [7.0] * 3
    assert np.isnan(unpacked(packed(np.full(2, np.nan)))).all()
    time = np.frombuffer(base64.b64decode(floats(np.array([0.02, 3599.98]))), "<f4")
    assert time == pytest.approx([0.02, 3599.98], rel=1e-7)


def test_joints_and_signals_of_an_episode_are_together() -> None:
    """One recording with its joints, their lines by cause, and what else was logged."""
    time = np.arange(0, 1, 0.01)
    signal = Signal("a.csv", 0, "current", "servo", "A", None, time, time)
    other = Signal("b.csv", 0, "current", "servo", "A", None, time, time)
    evidence = Evidence(traces=(trace("elbow"), trace("wrist")), signals=(signal, other))
    where = (JointGap("wrist", 0.8, 0.2), JointGap("elbow", 0.2, 0.1))
    gap = GapMetrics("rad", 0.2, 0.1, 0.01, 0.5, (0.4, 0.6), True)
    rest = Unexplained(0.5, "none")
    [found], total = recordings(Report("unexplained", gap, where, (), rest, evidence=evidence))
    assert total == 1
    assert [joint["name"] for joint in found["joints"]] == ["wrist", "elbow"]
    assert set(found["joints"][0]["lines"]) == {"", "0", "1", "all"}
    assert found["starts"] == [0, 50]
    assert len(found["signals"]) == 1
    np.testing.assert_allclose(unpacked(found["signals"][0]["values"]), time, atol=1e-4)
