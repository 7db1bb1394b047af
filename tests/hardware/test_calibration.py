"""A calibration moves zeros, signs and limits, and is refused on another robot."""

from __future__ import annotations

import json

import numpy as np
import pytest

from hardware.calibration import (
    Calibration,
    Joint,
    apply_calibration,
    calibration_of,
    read_calibration,
    write_calibration,
)
from hardware.config import load_robot
from hardware.errors import RobotError


def test_round_trip(tmp_path):
    """What a robot's file says survives writing, reading and applying."""
    robot = load_robot("bench1")
    path = tmp_path / "bench1.json"
    write_calibration(path, calibration_of(robot))
    back = apply_calibration(robot, read_calibration(path))
    assert (back.servos[0].zero, back.servos[0].sign) == (2048, 1)
    np.testing.assert_allclose(back.servos[0].position, robot.servos[0].position, atol=8e-4)
    assert json.loads(path.read_text())["joints"]["hinge"]["model"] == "xl330-m288"


def test_lerobot_file(tmp_path):
    """LeRobot's table of joints is read: offset and direction move the zero and the range."""
    path = tmp_path / "lerobot.json"
    entry = {
        "id": 1,
        "drive_mode": 1,
        "homing_offset": 48,
        "range_min": 1500,
        "range_max": 2500,
    }
    path.write_text(json.dumps({"hinge": entry}))
    servo = apply_calibration(load_robot("bench1"), read_calibration(path)).servos[0]
    assert servo.angle(2000) == 0
    assert servo.position[0] == pytest.approx(-500 * 2 * np.pi / 4096)
    assert servo.position[1] == pytest.approx(500 * 2 * np.pi / 4096)
    assert servo.angle(1500) > 0


@pytest.mark.parametrize(
    ("calibration", "message"),
    [
        (
            Calibration({"hinge": Joint(1, 0, 0, 1, 4000)}, "quad8"),
            "made on 'quad8', not on 'bench",
        ),
        (Calibration({"hing": Joint(1, 0, 0, 1, 4000)}), r"'hing' \(did you mean 'hinge'"),
        (Calibration({}), "lacks the joint 'hinge'"),
        (Calibration({"hinge": Joint(2, 0, 0, 1, 4000)}), r"servo 2 .*, the robot has servo 1"),
        (Calibration({"hinge": Joint(1, 0, 0, 4000, 4095)}), "nothing in common"),
    ],
)
def test_another_robots_is_refused(calibration, message):
    """A calibration of other names, IDs, types or ranges is refused."""
    with pytest.raises(RobotError, match=message):
        apply_calibration(load_robot("bench1"), calibration)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "cannot be read"),
        ("[]", "not list"),
        ('{"schema": 9, "joints": {}}', "schema 9 is unknown"),
        ('{"hinge": {"id": "1"}}', "hinge: id is '1', not a whole number"),
        ('{"hinge": 3}', "hinge: a joint's calibration is a table"),
        (
            '{"h": {"id":1,"drive_mode":0,"homing_offset":0,"range_min":5,"range_max":4}}',
            "range_min 5 is not below",
        ),
    ],
)
def test_damaged_files(tmp_path, text, message):
    """A file that is no calibration is refused with the joint and field."""
    path = tmp_path / "c.json"
    path.write_text(text)
    with pytest.raises(RobotError, match=message):
        read_calibration(path)
