"""The emulated IMU against closed forms: gravity, turns, latency, bias and noise."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hardware.body import EmulatedBody
from hardware.config import Robot, load_robot, make_robot
from hardware.emulator.imu import EmulatedImu
from hardware.emulator.inertial import InertialSensor
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError
from hardware.imu import rvc
from hardware.parts import ImuErrors
from tests.hardware.test_multi_bus import data_of

READINGS = 4000  # so that a mean is known to 1.6 % of the noise


def quadruped(**errors: Any) -> Robot:
    """Return quad12 whose IMU errs only as it is told."""
    robot = load_robot("quad12")
    assert robot.imu is not None
    return replace(robot, imu=replace(robot.imu, emulated=ImuErrors(**errors)))


def held(**errors: Any) -> InertialSensor:
    """Return the IMU of a level robot that is held."""
    world = EmulatedRobot(quadruped(**errors))
    world.hold()
    world.advance(0.01)
    assert world.inertial is not None
    return world.inertial


def many(imu: InertialSensor, name: str) -> np.ndarray:
    """Return readings of a quantity, (n, k)."""
    return np.array([imu.measure()[name] for _ in range(READINGS)])


def test_a_resting_robot_feels_its_weight_upwards():
    """Held level and standing on its feet: 9.81 m/s² along the world's z, and no turning."""
    assert held().measure()["acceleration"] == pytest.approx([0, 0, 9.81], abs=1e-9)
    world = EmulatedRobot(quadruped())
    for servo in world.servos:
        servo.memory["torque_enable"] = 1
        world.firmware.load(servo.index)
    ups, rates = [], []
    for tick in range(1000, 1500):  # counts of the encoders keep it moving a little
        world.advance(tick * 0.001)
        assert world.inertial is not None
        seen = world.inertial.measure()
        turn = Rotation.from_quat(seen["orientation"], scalar_first=True)
        ups.append(turn.apply(seen["acceleration"]))
        rates.append(seen["gyro"])
    assert np.mean(ups, axis=0) == pytest.approx([0, 0, 9.81], abs=0.02)
    assert np.mean(rates, axis=0) == pytest.approx([0, 0, 0], abs=2e-3)


def test_a_turned_robot_feels_its_weight_along_its_own_axes():
    """Rolled by 0.3 rad, y feels g sin(0.3); pitched by 0.2, x feels -g sin(0.2)."""
    for axis, angle, wanted in (
        ([1, 0, 0], 0.3, [0, np.sin(0.3), np.cos(0.3)]),
        ([0, 1, 0], 0.2, [-np.sin(0.2), 0, np.cos(0.2)]),
        ([0, 0, 1], 1.0, [0, 0, 1]),
    ):
        world = EmulatedRobot(quadruped())
        turn = Rotation.from_rotvec(np.array(axis) * angle).as_quat(scalar_first=True)
        world.mechanics.data.qpos[3:7] = turn
        world.mechanics.hold(np.ones(12, bool))
        world._held[:] = True
        world.advance(0.01)
        assert world.inertial is not None
        seen = world.inertial.measure()
        assert seen["orientation"] == pytest.approx(turn, abs=1e-4)  # held once a tick
        assert seen["acceleration"] == pytest.approx(9.81 * np.array(wanted), abs=1e-3)


def test_a_falling_robot_feels_nothing_and_its_spin():
    """In free fall all parts fall alike: no acceleration is felt; the gyro has the turn's speed."""
    world = EmulatedRobot(quadruped())
    data = world.mechanics.data
    data.qpos[2] = 3.0
    world.advance(0.0)
    assert world.inertial is not None
    assert world.inertial.measure()["acceleration"] == pytest.approx([0, 0, 0], abs=1e-6)
    data.qvel[3:6] = 0.5, -1.0, 4.0
    world.advance(0.001)
    assert world.inertial.measure()["gyro"] == pytest.approx([0.5, -1.0, 4.0], abs=0.05)


def test_latency_shifts_a_reading():
    """With 20 ms, what is read now is what a part without latency read 20 ticks before."""
    series = {}
    for latency in (0.0, 0.02):
        world = EmulatedRobot(quadruped(latency=latency))
        world.mechanics.data.qvel[3:6] = 1.0, -0.5, 2.0
        assert world.inertial is not None
        seen = []
        for tick in range(80):
            world.advance(tick * 0.001)
            seen.append(np.concatenate(list(world.inertial.measure().values())))
        series[latency] = np.array(seen)
    np.testing.assert_array_equal(series[0.02][20:], series[0.0][:-20])
    assert np.abs(series[0.02] - series[0.0]).max() > 0.1


def test_bias_is_the_mean_and_noise_the_spread():
    """Of a robot that is held: the mean is the truth and the bias, the deviation the noise."""
    imu = held(
        gyro_noise=0.02,
        gyro_bias=(0.01, 0.0, -0.03),
        acceleration_noise=0.3,
        acceleration_bias=(0.1, -0.2, 0.05),
    )
    for name, noise, mean in (
        ("gyro", 0.02, [0.01, 0.0, -0.03]),
        ("acceleration", 0.3, [0.1, -0.2, 9.86]),
    ):
        seen = many(imu, name)
        assert seen.mean(axis=0) == pytest.approx(mean, abs=4 * noise / np.sqrt(READINGS))
        assert seen.std(axis=0) == pytest.approx(np.full(3, noise), rel=0.05)
    assert imu.measure()["orientation"] == pytest.approx([1, 0, 0, 0], abs=1e-9)


def test_the_noise_of_an_orientation_is_a_small_turn():
    """Its rotation vector deviates by the setting about each axis, and it stays a rotation."""
    seen = many(held(orientation_noise=0.01), "orientation")
    assert np.linalg.norm(seen, axis=1) == pytest.approx(np.ones(READINGS))
    turns = Rotation.from_quat(seen, scalar_first=True).as_rotvec()
    assert turns.std(axis=0) == pytest.approx(np.full(3, 0.01), rel=0.05)
    assert turns.mean(axis=0) == pytest.approx(np.zeros(3), abs=4 * 0.01 / np.sqrt(READINGS))


def test_noise_is_of_the_seed_and_touches_nothing_else():
    """The same seed gives the same readings; the robot moves as it does with a perfect part."""
    seen = {}
    for key, seed, noise in (("a", 1, 0.1), ("b", 1, 0.1), ("c", 2, 0.1), ("exact", 1, 0.0)):
        world = EmulatedRobot(quadruped(gyro_noise=noise), seed=seed)
        world.advance(0.3)
        assert world.inertial is not None
        seen[key] = world.inertial.measure()["gyro"], world.mechanics.data.qpos.copy()
    np.testing.assert_array_equal(seen["a"][0], seen["b"][0])
    assert np.abs(seen["a"][0] - seen["c"][0]).max() > 1e-3
    np.testing.assert_array_equal(seen["a"][1], seen["exact"][1])


def test_a_robot_without_ports_measures_what_its_file_says():
    """The accelerometer is one of the body's sensors; it errs as the file says, as frames do."""
    robot = quadruped(measures=("acceleration",), acceleration_bias=(0.0, 0.0, 1.0))
    world = EmulatedRobot(robot)
    world.hold()
    body = EmulatedBody(world)
    assert body.names == ("acceleration", "position")
    assert body.measure(0.02)["acceleration"] == pytest.approx([0, 0, 10.81], abs=1e-9)
    [*_, (_, data)] = EmulatedImu(world).until(0.05)
    [frame] = rvc.Parser().feed(data)
    assert frame.acceleration == pytest.approx([0, 0, 10.81], abs=rvc.MILLI_G)


def test_what_an_emulated_imu_cannot_be():
    """Unknown quantities and keys, and numbers below 0, are named with their place."""
    data = data_of("quad12")

    def made(**changes: Any) -> Robot:
        return make_robot(data | {"imu": data["imu"] | {"emulated": changes}})

    assert made().imu == quadruped().imu
    with pytest.raises(RobotError, match=r"measures: \['speed'\]; it is a list of 'orientation'"):
        made(measures=["speed"])
    with pytest.raises(RobotError, match=r"latency: -0\.1 is below 0"):
        made(latency=-0.1)
    with pytest.raises(RobotError, match=r"unknown key 'gyro_nois'.*did you mean 'gyro_noise'"):
        made(gyro_nois=0.1)
    with pytest.raises(RobotError, match=r"gyro_bias: 0\.1 is not 3 numbers"):
        made(gyro_bias=0.1)
