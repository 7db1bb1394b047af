"""A real servo whose data sheet is wrong: what a diagnosis of its logs says."""

import os
from pathlib import Path

import pytest

from hardware.log import read_logs
from sim2real.diagnosis.diagnose import diagnose

DATA = os.environ.get("SIM2REAL_DATA")
FRICTION = {"coulomb_friction", "viscous_friction", "stribeck_friction", "load_dependent_friction"}


@pytest.mark.slow
@pytest.mark.skipif(DATA is None, reason="SIM2REAL_DATA names no folder of real logs")
def test_a_servos_manual_is_corrected() -> None:
    """Half the manual's gain, and friction, are what twelve logs of three gains have in common."""
    report = diagnose(read_logs(Path(DATA or "") / "xl330_bench"))
    first, second = report.causes[:2]
    gain, rubs = (first, second) if first.effect == "position_gain" else (second, first)
    assert gain.effect == "position_gain"
    assert 0.45 < gain.value < 0.65
    assert rubs.effect in FRICTION
    assert report.gap.closed is not None and report.gap.closed > 0.6
    (law,) = [one for one in report.preflight if one.check == "control_law"]
    assert "0.51 of the model's" in law.finding  # the PWM says the same; no fit looked at it
