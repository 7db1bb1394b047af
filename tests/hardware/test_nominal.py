"""A public model gets a robot's servos as actuators, and the emulator agrees with it."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.replay.derivative import FILTER
from envs.servo_numbers import DERIVATIVE_TIME, TORQUE_RATE, servo_numbers
from envs.tasks.servo.drive import max_torque_rate
from envs.tasks.servo.drive import servo as simulated
from hardware.config import Robot, load_robot
from hardware.connect import make_driver
from hardware.emulator.control import DERIVATIVE_FILTER
from hardware.errors import RobotError
from hardware.nominal import nominal, write_nominal_model
from hardware.record import record
from hardware.safety import Guard
from hardware.stand import home_pose, write_stand_model
from tests.hardware.stand_ins import SHAPES, public_model
from tests.hardware.test_record import replay


@pytest.mark.parametrize("name", ["arm6", "bench1", "hopper2", "quad12"])
def test_our_own_models_are_nominal(name: str) -> None:
    """Gains, limits, back-EMF and rotors are what the models of the project state."""
    robot = load_robot(name)
    model, own = nominal(robot).compile(), mujoco.MjModel.from_xml_path(str(robot.model))
    for field in (
        "actuator_gainprm",
        "actuator_biasprm",
        "actuator_forcerange",
        "actuator_damping",
    ):
        np.testing.assert_allclose(getattr(model, field), getattr(own, field), rtol=1e-3)
    np.testing.assert_allclose(model.dof_armature, own.dof_armature, rtol=1e-3)


@pytest.mark.parametrize("name", SHAPES)
def test_what_is_diagnosed_and_what_is_trained_are_the_same_servos(name: str, tmp_path) -> None:
    """The task's actuators, made from the same file by another room, have the same numbers."""
    robot = load_robot(name, str(public_model(name, tmp_path)))
    model, spec = nominal(robot).compile(), nominal(robot)
    for servo in robot.servos:
        registers, volts = robot.registers_of(servo), robot.supply_of(servo).voltage
        simulated(spec.actuator(servo.name), servo.model, registers, volts, 0.0, 0.001)
    theirs = spec.compile()
    for field in ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange"):
        np.testing.assert_allclose(getattr(model, field), getattr(theirs, field), rtol=2e-3)
    trained = {s.name: max_torque_rate(s.model, robot.registers_of(s)) for s in robot.servos}
    stated = servo_numbers(model, TORQUE_RATE, np.inf)
    for actuator, rate in trained.items():
        assert stated[model.actuator(actuator).id] == pytest.approx(rate, rel=2e-3)


@pytest.mark.parametrize("name", SHAPES)
def test_the_emulator_is_near_the_nominal_model(name: str, tmp_path: Path) -> None:
    """Each robot arms, follows a motion, and its log replays within four counts RMS."""
    robot = load_robot(name, str(public_model(name, tmp_path)))
    robot = write_stand_model(write_nominal_model(robot, tmp_path / "nominal.xml"), tmp_path)
    error = replay_error(robot, size=0.1, fastest=9.0)
    assert np.sqrt(np.mean(error**2)) < 4 * 0.00153


def replay_error(robot: Robot, size: float, fastest: float) -> np.ndarray:
    """Return how far the model is from the emulated robot [rad], rms of each joint.

    The goals are waves of this size [rad] about the home pose, of up to `fastest` rad/s.
    """
    driver = make_driver(robot)
    driver.connect()
    driver.configure()
    middle = home_pose(robot)
    time = np.arange(40)[:, None] / robot.rate
    waves = size * np.sin(time * (fastest / 3 + np.arange(len(middle)) % 7 * fastest / 9))
    low, high = np.array([servo.position for servo in robot.servos]).T
    with Guard(driver) as guard:
        guard.arm()
        guard.move_to(middle, speed=1.0)
        log = record(guard, np.clip(middle + waves, low, high))
    for servo in robot.servos:
        volts = log.column(f"voltage.{servo.name}")
        np.testing.assert_allclose(volts, robot.supply_of(servo).voltage, atol=0.06)
    joints = [c for c in log.columns if c.startswith("qpos.")]
    measured = np.stack([log.column(joint) for joint in joints], axis=1)
    return np.sqrt(np.mean((replay(log, robot) - measured) ** 2, axis=0))


def test_a_derivative_gain_is_named_with_its_time(tmp_path: Path) -> None:
    """The time is kd / kp, and a model that has it already gets it once; none without a gain."""
    robot = load_robot("leap_hand", str(public_model("leap_hand", tmp_path)))
    once = write_nominal_model(robot, tmp_path / "once.xml")
    for path in (once.model, write_nominal_model(once, tmp_path / "twice.xml").model):
        model = mujoco.MjModel.from_xml_path(str(path))
        assert model.nnumeric == len(robot.servos)
        # kd / kp = (D / 16) 1 ms / (P / 256), P = 600 and D = 200
        time = servo_numbers(model, DERIVATIVE_TIME, 0.0)[model.actuator("if_mcp_act").id]
        assert time == pytest.approx(200 / 16 * 1e-3 / (600 / 256))
    assert not nominal(load_robot("arm6")).compile().nnumeric


def test_a_replay_filters_a_derivative_as_the_emulated_servos_do() -> None:
    """One assumption, written in two rooms that know nothing of each other."""
    assert FILTER == DERIVATIVE_FILTER


def test_a_slope_of_the_voltage_is_a_rate_of_the_torque(tmp_path: Path) -> None:
    """An XL330's 140 is 0.277 V/ms, as K / R of torque; an XL430 has no such register."""
    robot = load_robot("koch", str(public_model("koch", tmp_path)))
    model = mujoco.MjModel.from_xml_path(
        str(write_nominal_model(robot, tmp_path / "koch.xml").model)
    )
    rates = servo_numbers(model, TORQUE_RATE, np.inf)
    small = np.array([servo.model == "xl330-m288" for servo in robot.servos])
    np.testing.assert_allclose(rates[small], 140 * 1.977 * 0.386 / 3.40, rtol=1e-5)
    assert 0 < small.sum() < len(small) and np.isinf(rates[~small]).all()


def test_servos_with_a_slope_and_a_derivative_gain_agree_with_the_nominal_model(
    tmp_path: Path,
) -> None:
    """Koch's small servos have both: in steps of 1 ms fast waves replay within three counts RMS."""
    public = public_model("koch", tmp_path)
    spec = mujoco.MjSpec.from_file(str(public))
    spec.option.timestep = 0.001  # s, for 4 ms: a command acts half a step late on average
    public.write_text(spec.to_xml())
    robot = write_nominal_model(load_robot("koch", str(public)), tmp_path / "nominal.xml")
    robot = write_stand_model(robot, tmp_path)
    assert replay_error(robot, size=0.15, fastest=14.0).max() < 3 * 0.00153


def test_a_model_of_other_actuators_is_refused(tmp_path: Path) -> None:
    """The actuators that are missing, and those that there are."""
    robot = load_robot("koch", str(public_model("so101", tmp_path)))
    with pytest.raises(
        RobotError, match=r"has no actuators 'base_rotation', 'pitch', .* it has 'sh"
    ):
        nominal(robot)
