"""Drifts that were put into a log are found, and a log on one clock is left alone."""

import pytest

from hardware.log import Log
from sim2real.diagnosis.preflight.clocks import check_clocks, stamp_drift
from tests.sim2real.diagnosis.preflight.stamped import log, silent


@pytest.mark.parametrize("ppm", [-200.0, 100.0, 200.0])
def test_a_drift_is_found_to_twenty_ppm(ppm: float) -> None:
    """A minute of stamps tells the two clocks' rates apart."""
    assert stamp_drift(log(ppm=ppm), "hinge")[0] == pytest.approx(ppm, abs=20)
    (finding,) = check_clocks([log(ppm=ppm)])
    assert finding.check == "drift" and ("fast" if ppm > 0 else "slow") in finding.finding


@pytest.mark.parametrize("seed", range(5))
def test_one_clock_is_left_alone(seed: int) -> None:
    """Jitter, counts and a constant latency are no finding."""
    assert list(check_clocks([log(seed=seed)])) == []


def test_a_nominal_clock_is_said() -> None:
    """Times that were computed from a frame's number cannot tell small delays."""
    made = log()
    (finding,) = check_clocks([Log(made.columns, {"clock": "nominal"})])
    assert "computed, not measured" in finding.finding


def test_logs_that_say_nothing() -> None:
    """A joint at rest, a handful of rows, or no speed: no finding and no error."""
    still, short, bare = silent()
    assert list(check_clocks([still, short, bare])) == []
