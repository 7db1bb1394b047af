"""A friction that is named where torques are commanded, and where rows bring their gains.

And a model that flies off: what holds it is no explanation.
"""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.signal import lfilter

from hardware.log import Log
from sim2real.diagnosis.diagnose import diagnose
from tests.sim2real.diagnosis import motors
from tests.sim2real.diagnosis.data import test_impedance as impedance

FRICTION, NOISE = 0.1, 3e-4  # N·m, rad
RATE, LATE = 100, 0.03  # Hz; s by which a servo's speed register is late
ROD = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body>
<joint name="a" axis="{axis}" {joint}/><geom type="capsule" fromto="0 0 0 .25 0 0" {geom}/></body>
</worldbody><actuator><motor name="a" joint="a"/></actuator></mujoco>"""
LIGHT = {"axis": "0 0 1", "geom": 'size=".01" mass=".01"'}
SWINGING = {"axis": "0 1 0", "geom": 'size=".02" mass=".3"'}
HEAVY = 'frictionloss="3" damping="2.8" armature="0.4"'


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


def rod(
    folder: Path, parts: dict[str, str], given: str, hidden: str, torque: np.ndarray
) -> tuple[Log, Path]:
    """Return a log of a rod at a joint, its speeds included, and its model, which has `given`."""
    path = folder / "rod.xml"
    path.write_text(ROD.format(joint=given, **parts), encoding="utf-8")
    model = mujoco.MjModel.from_xml_string(ROD.format(joint=hidden, **parts))
    data, time = mujoco.MjData(model), np.arange(len(torque)) / RATE
    seen, speed = np.zeros((2, len(time)))
    for row, sent in enumerate(torque):
        seen[row], speed[row], data.ctrl[0] = data.qpos[0], data.qvel[0], sent
        mujoco.mj_step(model, data, 5)
    columns = {"episode": np.zeros(len(time)), "time": time, "ctrl.a": torque}
    return noisy(Log({**columns, "qpos.a": seen, "qvel.a": speed})), path


def flies_off(folder: Path) -> tuple[Log, Path]:
    """Return the log of a heavily damped rod, and a model of it that nothing holds."""
    time = np.arange(1200) / RATE
    torque = 8 * np.sin(np.pi * time) + 4 * np.sin(2.2 * np.pi * time + 1)
    log, model = rod(folder, LIGHT, "", HEAVY, torque)
    return Log({name: values for name, values in log.columns.items() if name != "qvel.a"}), model


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_what_only_holds_a_model_that_flies_off_explains_nothing(tmp_path: Path) -> None:
    """It closes nearly all of a gap of radians, as a joint that stays would: that is no cause."""
    log, model = flies_off(tmp_path)
    report = diagnose([log], model, exclude=("coulomb_friction", "viscous_friction"))
    assert report.gap.before > 1.0
    assert report.verdict in ("partly_explained", "unexplained")
    assert all(cause.confidence < 0.5 for cause in report.causes)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_what_holds_a_robot_is_found_though_its_model_flies_off(tmp_path: Path) -> None:
    """Damping, rotor and friction, each a hundred times the rod's own, to a few per cent."""
    log, model = flies_off(tmp_path)
    report = diagnose([log], model)
    found = {cause.effect: cause.value for cause in report.causes}
    assert found == pytest.approx(
        {"viscous_friction": 2.8, "armature": 0.4, "coulomb_friction": 3.0}, rel=0.05
    )
    assert report.gap.closed is not None and report.gap.closed > 0.99


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_late_speed_of_one_joint_is_no_wrong_clock(tmp_path: Path) -> None:
    """A rotor and friction make it slower than its model, at the rate that its speeds tell."""
    time = np.arange(1200) / RATE
    torque = 0.5 * np.sin(2 * np.pi * (0.3 * time + 0.06 * time**2))
    given, hidden = 'armature="0.001"', 'armature="0.008" frictionloss="0.1"'
    log, model = rod(tmp_path, SWINGING, given, hidden, torque)
    share = 1 - np.exp(-1 / RATE / LATE)
    late = np.asarray(lfilter([share], [1, share - 1], log.column("qvel.a")))
    report = diagnose([Log({**log.columns, "qvel.a": late})], model)
    assert report.causes and all(cause.kind == "robot" for cause in report.causes)
    assert "rate" not in {finding.check for finding in report.preflight}
