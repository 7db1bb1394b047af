"""A friction that is named where torques are commanded, and where rows bring their gains."""

from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.diagnose import diagnose
from tests.sim2real.diagnosis import motors
from tests.sim2real.diagnosis.data import test_impedance as impedance

FRICTION, NOISE = 0.1, 3e-4  # N·m, rad


def noisy(log: Log) -> Log:
    """Return the log with noise on its positions."""
    rng = np.random.default_rng(1)
    columns = {
        name: values + NOISE * rng.normal(size=len(values)) if name.startswith("qpos") else values
        for name, values in log.columns.items()
    }
    return Log(columns)


def made(kind: str) -> Log:
    """Return a log of the arm of motors whose second joint has the friction."""
    if kind == "torque":
        return motors.make_log(FRICTION, 8.0)
    held = ("coulomb_friction", {"where": "b"}, FRICTION)
    return impedance.make_log(impedance.rows(8.0), held)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("kind", ["torque", "impedance"])
def test_a_hidden_friction_is_named(kind: str, tmp_path: Path) -> None:
    """Alone, at its joint, within a few per cent of its value."""
    report = diagnose([noisy(made(kind))], motors.model(tmp_path))
    (cause,) = report.causes
    assert (cause.effect, cause.where) == ("coulomb_friction", "b")
    assert cause.value == pytest.approx(FRICTION, rel=0.05)
    assert report.gap.closed is not None and report.gap.closed > 0.95
