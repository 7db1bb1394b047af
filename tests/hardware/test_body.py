"""The emulated robot's IMU and tracker tell where its base is, and a hand puts it back."""

import numpy as np
import pytest

from hardware.body import SIZES, EmulatedBody
from hardware.config import load_robot
from hardware.emulator.world import EmulatedRobot


@pytest.mark.parametrize(
    ("name", "sensors"),
    [("bench1", ()), ("hopper2", ("position",)), ("quad8", ("orientation", "gyro", "position"))],
)
def test_each_robot_has_the_sensors_of_its_model(name, sensors):
    """An IMU where the model has one, a tracker where the base can move."""
    world = EmulatedRobot(load_robot(name))
    body = EmulatedBody(world)
    assert body.names == sensors
    measured = body.measure(0.05)
    assert {key: len(value) for key, value in measured.items()} == {n: SIZES[n] for n in sensors}
    assert world.time > 0.05


def test_they_tell_what_the_base_does():
    """A base that falls from 0.5 m and turns: height, orientation and rate as in the physics."""
    world = EmulatedRobot(load_robot("quad8"))
    body, data = EmulatedBody(world), world.mechanics.data
    data.qpos[2], data.qvel[3:6] = 0.5, (0.0, 0.0, 1.5)
    seen = body.measure(0.1)
    assert seen["position"][2] == pytest.approx(0.5 - 9.81 * 0.1**2 / 2, abs=0.01)
    assert seen["orientation"] == pytest.approx(data.qpos[3:7], abs=2e-3)
    assert np.linalg.norm(seen["orientation"]) == pytest.approx(1.0)
    assert seen["gyro"][2] == pytest.approx(1.5, abs=0.1)
    assert 2 * np.arctan2(seen["orientation"][3], seen["orientation"][0]) > 0.1


def test_putting_back_leaves_the_servos_alone():
    """The base is home and at rest; joints and their speeds are as they were."""
    world = EmulatedRobot(load_robot("quad8"))
    body, mechanics = EmulatedBody(world), world.mechanics
    home = mechanics.data.qpos[:7].copy()
    mechanics.data.qpos[:3], mechanics.data.qvel[:6] = (3.0, 2.0, 1.0), 1.0
    world.advance(0.02)
    angles, speeds = mechanics.angle.copy(), mechanics.speed.copy()
    body.return_to_start(0.02)
    np.testing.assert_array_equal(mechanics.data.qpos[:7], home)
    np.testing.assert_array_equal(mechanics.data.qvel[:6], 0.0)
    np.testing.assert_array_equal(mechanics.angle, angles)
    np.testing.assert_array_equal(mechanics.speed, speeds)
