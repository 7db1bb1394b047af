"""Torques that are only the servo's law."""

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.data.impedance import with_laws
from sim2real.diagnosis.preflight.checks import NOTES, preflight
from sim2real.diagnosis.preflight.control_laws import check_torques, measured_torques
from tests.sim2real.diagnosis import arm, motors
from tests.sim2real.diagnosis.data import test_impedance as impedance


def found(noise: float, column: str = "sensor.torque_a", kd: float = 0.0) -> list[str | None]:
    """Return the actuators whose torque is found to be computed, of a log with such a column."""
    log = arm.make_log(seconds=8.0, noise=1e-4)
    own, rng = dict(log.columns), np.random.default_rng(0)
    own["qvel.a"] = np.gradient(own["qpos.a"], own["time"])
    torque = 8.0 * (own["ctrl.a"] - own["qpos.a"]) - kd * own["qvel.a"]
    own[column] = np.clip(torque + noise * rng.normal(size=len(log)), -1.5, 1.5)
    model = arm.spec().compile()
    return [finding.where for finding in check_torques([(Log(own), model)])]


@pytest.mark.parametrize("column", ["sensor.torque_a", "sensor.effort_a", "current.a"])
@pytest.mark.parametrize("kd", [0.0, 0.4])
def test_a_torque_that_is_the_law_is_found(column: str, kd: float) -> None:
    """Whatever it is called, and where it is clipped at a limit."""
    assert found(0.0, column, kd) == ["a"]


def test_a_measured_torque_is_left_alone() -> None:
    """A sensor's noise of two per cent is enough, and a log without one says nothing."""
    assert found(0.02) == []
    log = arm.make_log(seconds=2.0)
    assert list(check_torques([(log, arm.spec().compile())])) == []


def test_a_servo_s_load_is_no_torque() -> None:
    """It is a duty, back-EMF included: no evidence of a torque, and nothing that was computed."""
    log = arm.make_log(seconds=2.0)
    log = Log({**log.columns, "sensor.load_a": np.sin(5 * log.time)})
    pairs = [(log, arm.spec().compile())]
    assert measured_torques(pairs) == {}
    assert found(0.0, "sensor.load_a") == []


def test_the_law_of_each_row_counts() -> None:
    """A joint under impedance control whose torque is its rows' law."""
    log = arm.make_log(seconds=8.0)
    own = dict(log.columns)
    own["kp.a"] = 4.0 + 3.0 * (own["time"] % 1 < 0.5)
    own["torque_ff.a"] = 0.1 * np.sin(3 * own["time"])
    own["current.a"] = 1.7 * (own["kp.a"] * (own["ctrl.a"] - own["qpos.a"]) + own["torque_ff.a"])
    model = arm.spec().compile()
    assert [f.where for f in check_torques([(Log(own), model)])] == ["a"]


@pytest.mark.parametrize("kind", ["torque", "impedance"])
def test_a_right_log_of_motors_has_nothing_to_mend(kind: str) -> None:
    """Its duty follows the torque alone, and no check takes a torque for a goal."""
    if kind == "torque":
        log, spec = motors.make_log(0.05, 8.0), motors.spec()
        duty = {f"sensor.duty_{n}": log.column(f"ctrl.{n}") / 10 for n in "ab"}
        log = Log({**log.columns, **duty})
    else:
        log = impedance.make_log(impedance.rows(8.0))
        spec = with_laws(motors.spec(), log)
    found = preflight([log], [spec])
    assert [(f.check, f.where) for f in found if f.check not in NOTES] == []
