"""The IMU of an emulated robot with hidden faults, against what is true."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hardware.body import EmulatedBody
from hardware.config import Robot, load_robot
from hardware.emulator.hidden import make_hidden
from hardware.emulator.mechanics import TICK
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError


@pytest.fixture(scope="module")
def robot() -> Robot:
    """Return a robot with an IMU on its base."""
    return load_robot("quad8")


def fallen(
    robot: Robot, *hidden: dict[str, Any], ticks: int = 100
) -> tuple[EmulatedRobot, list[dict]]:
    """Let a robot fall without torque, its base turning; return what was true at each tick."""
    world, true = EmulatedRobot(robot, make_hidden(list(hidden), robot), seed=0), []
    world.mechanics.data.qvel[3:6] = [1.0, -0.5, 0.3]
    for tick in range(ticks):
        world.advance(tick * TICK)
        true.append(world.mechanics.sensors())
    return world, true


def test_without_faults_it_is_true(robot: Robot) -> None:
    """Bit for bit."""
    world, true = fallen(robot)
    said = EmulatedBody(world).measure((len(true) - 1) * TICK)
    np.testing.assert_array_equal(said["orientation"], true[-1]["orientation"])
    np.testing.assert_array_equal(said["gyro"], true[-1]["gyro"])


def test_a_late_part_says_what_was_true(robot: Robot) -> None:
    """Orientation and gyro are 20 ms old; the tracker is not."""
    world, true = fallen(robot, {"effect": "imu_delay", "value": 0.02})
    said = EmulatedBody(world).measure((len(true) - 1) * TICK)
    old = true[-1 - round(0.02 / TICK)]
    np.testing.assert_array_equal(said["orientation"], old["orientation"])
    np.testing.assert_array_equal(said["gyro"], old["gyro"])
    assert not np.allclose(old["orientation"], true[-1]["orientation"], atol=1e-4)


def test_mounting_scale_and_bias(robot: Robot) -> None:
    """The part is turned in the robot's axes; its gyro is scaled along its own, then off."""
    mount, bias = [0.1, -0.05, 0.2], [0.1, 0.0, -0.3]
    faults = [("imu_mounting", mount), ("gyro_bias", bias), ("gyro_scale", 1.5)]
    world, true = fallen(robot, *({"effect": e, "value": v} for e, v in faults))
    assert world.inertial is not None
    said, turn = world.inertial.measure(), Rotation.from_rotvec(mount)
    real = Rotation.from_quat(true[-1]["orientation"], scalar_first=True)
    told = Rotation.from_quat(said["orientation"], scalar_first=True)
    assert (told.inv() * (real * turn)).magnitude() < 1e-9
    expected = 1.5 * turn.inv().apply(true[-1]["gyro"]) + bias
    np.testing.assert_allclose(said["gyro"], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"effect": "imu_mounting", "value": 0.1}, "list of 3 numbers"),
        ({"effect": "gyro_bias", "value": [0.1, 0.2]}, "list of 3 numbers"),
        ({"effect": "imu_delay", "value": -0.01}, "at least 0"),
        ({"effect": "gyro_scale", "value": 1.1, "where": "torso"}, "leave out where"),
    ],
)
def test_a_wrong_entry_is_refused(robot: Robot, entry: dict[str, Any], words: str) -> None:
    """Number and size of the values, and the place."""
    with pytest.raises(RobotError, match=words):
        make_hidden([entry], robot)


def test_a_robot_without_an_imu_is_refused() -> None:
    """Nothing would show what it hides."""
    arm = load_robot("bench1")
    with pytest.raises(RobotError, match="names no IMU"):
        EmulatedRobot(arm, make_hidden([{"effect": "imu_delay", "value": 0.02}], arm))
