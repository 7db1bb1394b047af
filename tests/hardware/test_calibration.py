"""A calibration moves zeros, signs and limits, and is refused on another robot."""

import json
from dataclasses import replace

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

STEP = 2 * np.pi / 4096  # rad, a count
OWN = {"drive_mode": 0, "homing_offset": 0}


def test_round_trip(tmp_path):
    """A joint that was calibrated by hand survives writing, reading and applying."""
    robot = load_robot("bench1")
    joint = Joint(1, 0, 0, 1500, 2600, model="xl330-m288", zero=2000, sign=-1)
    path = tmp_path / "bench1.json"
    write_calibration(path, Calibration({"hinge": joint}, robot.name))
    read = read_calibration(path)
    assert calibration_of(apply_calibration(robot, read)) == read
    assert read.joints["hinge"] == joint
    servo = apply_calibration(robot, read).servos[0]
    assert (servo.zero, servo.sign) == (2000, -1)
    np.testing.assert_allclose(servo.position, [-600 * STEP, 500 * STEP])
    assert json.loads(path.read_text())["schema"] == 2


def applied(tmp_path, **fields):
    """Return the servo of bench1, its own limits wide, under LeRobot's table of these fields."""
    path = tmp_path / "lerobot.json"
    path.write_text(json.dumps({"hinge": {"id": 1, "drive_mode": 0, **fields}}))
    robot = load_robot("bench1")
    wide = replace(robot.servos[0], position=(-3.0, 3.0))
    robot = replace(robot, servos=(wide,))
    return apply_calibration(robot, read_calibration(path)).servos[0]


def test_lerobots_joints_go_by_their_ids(tmp_path):
    """A Koch's joints have other names in LeRobot; with another ID among them names must agree."""
    names = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
    table = {
        name: dict(OWN, id=i, range_min=500, range_max=3500 + i) for i, name in enumerate(names, 1)
    }
    path, robot = tmp_path / "koch.json", load_robot("koch", needs_model=False)
    path.write_text(json.dumps(table))
    servos = apply_calibration(robot, read_calibration(path)).servos
    assert [servo.zero for servo in servos] == [(4000 + i) / 2 for i in range(1, 7)]
    path.write_text(json.dumps(table | {"gripper": table["gripper"] | {"id": 7}}))
    with pytest.raises(RobotError, match="the calibration has the joint 'shoulder_pan'"):
        apply_calibration(robot, read_calibration(path))


def test_lerobot_ranges_have_the_offset_applied(tmp_path):
    """A worked example: encoder at 1000 in the middle, travel 400 to 1600.

    LeRobot writes 2047 - 1000 = 1047 as homing offset into the servo, so that the middle reads
    2047, and then records what the servo reports at the ends: 400 + 1047 = 1447 and 1600 + 1047 =
    2647. The encoder's own counts, which this program sees, are 400 and 1600 again: 600 counts or
    0.920 rad to either side of 1000. Read as the encoder's counts, 1447 and 2647 would put the
    upper limit 1047 counts, 92 degrees, beyond the stop.
    """
    servo = applied(tmp_path, homing_offset=1047, range_min=1447, range_max=2647)
    assert servo.zero == 1000
    assert servo.sign == 1
    assert [servo.count(angle) for angle in servo.position] == [400, 1600]
    np.testing.assert_allclose(servo.position, [-0.92039, 0.92039], atol=1e-5)
    assert servo.angle(1100) == pytest.approx(100 * STEP)


def test_lerobot_measures_from_the_middle_of_the_range(tmp_path):
    """A joint that was held off its middle at the start: travel 300 to 1600, angle 0 at 950.

    LeRobot's degrees are (reported - (range_min + range_max) / 2) * 360 / 4095.
    """
    servo = applied(tmp_path, homing_offset=1047, range_min=1347, range_max=2647)
    assert servo.zero == 950
    reported = 1100 + 1047
    degrees = (reported - (1347 + 2647) / 2) * 360 / 4095
    assert np.degrees(servo.angle(1100)) == pytest.approx(degrees, rel=1e-3)
    assert [servo.count(angle) for angle in servo.position] == [300, 1600]
    even = applied(tmp_path, homing_offset=0, range_min=0, range_max=4095)
    assert even.zero == 2047.5  # between two counts


def test_lerobot_reversed_servo(tmp_path):
    """A servo that counts backwards itself: reported = offset - encoder, angles as reported.

    In the middle at 1000 LeRobot reads -1000 and writes 2047 + 1000 = 3047; travel 400 to 1600
    reads 2647 to 1447.
    """
    servo = applied(tmp_path, drive_mode=1, homing_offset=3047, range_min=1447, range_max=2647)
    assert (servo.zero, servo.sign) == (1000, -1)
    assert sorted(servo.count(angle) for angle in servo.position) == [400, 1600]
    assert servo.angle(900) == pytest.approx(100 * STEP)


def test_files_of_schema_1(tmp_path):
    """An old file keeps its meaning: ranges of the encoder, the zero 2048 less the offset."""
    entry = {"id": 1, "drive_mode": 1, "homing_offset": 48, "range_min": 1500, "range_max": 2500}
    path = tmp_path / "old.json"
    path.write_text(json.dumps({"schema": 1, "robot": "bench1", "joints": {"hinge": entry}}))
    servo = apply_calibration(load_robot("bench1"), read_calibration(path)).servos[0]
    assert servo.angle(2000) == 0
    np.testing.assert_allclose(servo.position, [-500 * STEP, 500 * STEP])
    assert servo.angle(1500) > 0


@pytest.mark.parametrize(
    ("calibration", "message"),
    [
        (Calibration({"hinge": Joint(1, 0, 0, 1, 4000)}, "quad8"), "made on 'quad8', not on 'b"),
        (Calibration({"hing": Joint(1, 0, 0, 1, 4000)}, "bench1"), r"'hing' \(did you mean 'hinge"),
        (Calibration({}), "lacks the joint 'hinge'"),
        (Calibration({"hinge": Joint(2, 0, 0, 1, 4000)}), r"servo 2 .*, but the robot has servo 1"),
        (Calibration({"hinge": Joint(1, 0, 0, 4000, 4095, zero=2048)}), "do not overlap"),
    ],
)
def test_another_robots_is_refused(calibration, message):
    """A calibration of other names, IDs, types or ranges is refused."""
    with pytest.raises(RobotError, match=message):
        apply_calibration(load_robot("bench1"), calibration)


def test_a_travel_over_the_encoders_seam_is_refused():
    """Limits from 1 rad below to 1.5 rad above 3500 would be counts beyond 4095."""
    robot = load_robot("bench1")
    wide = replace(robot, servos=(replace(robot.servos[0], position=(-3.1, 3.1)),))
    joint = Joint(1, 0, 0, 2848, 4478, model="xl330-m288", zero=3500)
    with pytest.raises(
        RobotError, match=r"'hinge'.* 2848 to 4478 .*seam lies .*; remount the horn"
    ):
        apply_calibration(wide, Calibration({"hinge": joint}, "bench1"))
    within = replace(wide, servos=(replace(wide.servos[0], position=(-1.0, 0.5)),))
    assert apply_calibration(within, Calibration({"hinge": joint}, "bench1"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "cannot be read"),
        ("[]", "not list"),
        ('{"schema": 9, "joints": {}}', "schema 9 is unknown"),
        ('{"hinge": {"id": "1"}}', "hinge: id is '1', not a whole number"),
        ('{"schema": 2, "joints": []}', r"joints: \[\] is not a table"),
        (
            '{"h": {"id":1,"drive_mode":2,"homing_offset":0,"range_min":5,"range_max":9}}',
            "drive_mode is 2; expected 0 or 1",
        ),
        (
            '{"h": {"id":1,"drive_mode":0,"homing_offset":0,"range_min":5,"range_max":9,"sign":0}}',
            "sign is 0",
        ),
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


@pytest.mark.parametrize(
    ("zero", "message"), [(99999, "do not overlap"), (float("nan"), "zero is nan, not a count")]
)
def test_a_zero_that_cannot_be_is_refused(tmp_path, zero, message):
    """Limits that are no numbers would hold nothing: a zero far away or of NaN is no zero."""
    path = tmp_path / "bench1.json"
    joint = Joint(1, 0, 0, 1000, 3000, model="xl330-m288", zero=zero)
    write_calibration(path, Calibration({"hinge": joint}, "bench1"))
    with pytest.raises(RobotError, match=message):
        apply_calibration(load_robot("bench1"), read_calibration(path))
