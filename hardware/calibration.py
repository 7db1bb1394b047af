"""A robot's calibration: each joint's zero, sign and limits, in one JSON file.

    write_calibration("bench1.json", calibration_of(robot))
    robot = apply_calibration(robot, read_calibration("bench1.json"))

The file has `schema`, `robot`, `date` and `joints`. A joint has LeRobot's fields with LeRobot's
meaning: `drive_mode` and `homing_offset` are what the servo itself applies to its encoder, and
`range_min` and `range_max` are counts with both applied:

    reported = +-encoder + homing_offset        (Dynamixel; - where drive_mode is 1)
    reported = encoder - homing_offset          (Feetech, whose drive_mode only turns the angles)

Beside them stand `model`, `zero` (the reported count where the joint's angle is 0) and `sign` (-1
where the angle falls as the reported count grows). LeRobot's own files, the table of joints alone,
have none of these three: angles are then measured from the middle of the range, as LeRobot does.
Files of schema 1 had the zero in `homing_offset` and ranges in counts of the encoder. Nothing of
a file is written into servos: this program works with their own offset and drive mode at 0.
Source: lerobot/motors/motors_bus.py, `set_half_turn_homings`, `record_ranges_of_motion` and
`_normalize`; the servos' manuals, Homing Offset(20) and Drive Mode(10).
"""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hardware.config import Robot
from hardware.errors import RobotError, did_you_mean, format_names
from hardware.files import atomic_write
from hardware.robot_checks import beyond_goals

SCHEMA = 2
SEAM = "the encoder's seam lies inside the travel; remount the horn, then calibrate again"
HALF_TURN = 2048  # counts, the zero that the offsets of schema 1 are relative to


@dataclass(frozen=True)
class Joint:
    """One joint's calibration, in counts; the module says what the fields mean."""

    id: int  # the servo's number on the bus
    drive_mode: int  # 1 if the servo itself counts backwards
    homing_offset: int  # what the servo itself adds to its counts
    range_min: int  # the least count, as the servo reports it
    range_max: int  # the largest
    model: str | None = None  # the servo's type, None if it is not known
    zero: float | None = None  # the reported count at the angle 0, None for the middle of the range
    sign: int = 1  # -1 if the angle falls as the reported count grows

    def encoder(self, reported: float, maker: str = "dynamixel") -> float:
        """Return the encoder's count, without offset and drive mode, at a reported count."""
        if maker == "feetech":
            return reported + self.homing_offset
        return (-1 if self.drive_mode else 1) * (reported - self.homing_offset)


@dataclass(frozen=True)
class Calibration:
    """The joints' calibration by actuator, and the robot it was made on (None: not known)."""

    joints: Mapping[str, Joint]
    robot: str | None = None


def calibration_of(robot: Robot) -> Calibration:
    """Return the calibration that a robot's own file contains."""
    joints = {}
    for servo in robot.servos:
        low, high = sorted(servo.count(angle) for angle in servo.position)
        joints[servo.name] = Joint(
            servo.id, 0, 0, low, high, model=servo.model, zero=servo.zero, sign=servo.sign
        )
    return Calibration(joints, robot.name)


def apply_calibration(robot: Robot, calibration: Calibration) -> Robot:
    """Return the robot with the calibration's signs and zeros, and limits within both.

    Raises:
        RobotError: it is another robot's: other names, IDs or servo types; or a joint travels over
            its encoder's seam.
    """
    if calibration.robot not in (None, robot.name):
        raise RobotError(
            f"this calibration was made on {calibration.robot!r}, not on {robot.name!r}; "
            "calibrate this robot: python -m hardware calibrate"
        )
    joints = _by_id(robot, calibration)
    unknown = [name for name in joints if name not in robot.names]
    missing = [name for name in robot.names if name not in joints]
    if unknown or missing:
        name = (unknown or missing)[0]
        hint = did_you_mean(name, robot.names if unknown else joints)
        what = "has the joint" if unknown else "lacks the joint"
        raise RobotError(
            f"the calibration {what} {name!r}{hint}; {robot.name} has {format_names(robot.names)}"
        )
    servos = []
    for servo in robot.servos:
        joint = joints[servo.name]
        if joint.id != servo.id or joint.model not in (None, servo.model):
            raise RobotError(
                f"the calibration of {servo.name!r} is for servo {joint.id} ({joint.model}), but "
                f"the robot has servo {servo.id} ({servo.model}); calibrate again"
            )
        middle = (joint.range_min + joint.range_max) / 2
        maker = servo.type.maker
        zero = joint.encoder(middle if joint.zero is None else joint.zero, maker)
        sign = -joint.sign if joint.drive_mode else joint.sign
        turned = replace(servo, sign=sign, zero=zero)
        ends = sorted(
            turned.angle(joint.encoder(end, maker)) for end in (joint.range_min, joint.range_max)
        )
        low, high = max(ends[0], servo.position[0]), min(ends[1], servo.position[1])
        if low >= high:
            raise RobotError(
                f"{servo.name!r}: its calibrated range [{ends[0]:.3f}, {ends[1]:.3f}] rad and the "
                f"robot's {list(servo.position)} do not overlap"
            )
        servos.append(replace(turned, position=(low, high)))
        beyond = beyond_goals(robot, servos[-1])
        if beyond is not None:
            raise RobotError(f"{servo.name!r}: its calibrated travel {beyond}: {SEAM}")
    return replace(robot, servos=tuple(servos))


def _by_id(robot: Robot, calibration: Calibration) -> Mapping[str, Joint]:
    """Return the joints by the robot's names: LeRobot's, whose names are its own, by their IDs."""
    joints, names = calibration.joints, {servo.id: servo.name for servo in robot.servos}
    same = sorted(joint.id for joint in joints.values()) == sorted(s.id for s in robot.servos)
    if calibration.robot is not None or set(joints) == set(robot.names) or not same:
        return joints
    return {names[joint.id]: joint for joint in joints.values()}


def write_calibration(path: str | Path, calibration: Calibration) -> None:
    """Write the file atomically."""
    data = {
        "schema": SCHEMA,
        "robot": calibration.robot,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "joints": {name: asdict(joint) for name, joint in calibration.joints.items()},
    }
    with atomic_write(Path(path)) as temporary:
        temporary.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


def read_calibration(path: str | Path) -> Calibration:
    """Read our file, or LeRobot's.

    Raises:
        RobotError: the file is missing or no calibration; the message says joint and field.
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RobotError(f"{path}: the calibration cannot be read: {error}") from None
    if not isinstance(data, dict):
        raise RobotError(f"{path}: a calibration is a table of joints, not {type(data).__name__}")
    schema = data.get("schema", SCHEMA)
    if schema not in (1, SCHEMA):
        raise RobotError(f"{path}: schema {schema!r} is unknown; this program reads 1 and {SCHEMA}")
    joints = data.get("joints", data)
    if not isinstance(joints, dict):
        raise RobotError(f"{path}: joints: {joints!r} is not a table of joints")
    made = {name: _joint(entry, f"{path}: {name}") for name, entry in joints.items()}
    if schema == 1:
        made = {name: _from_schema_1(joint) for name, joint in made.items()}
    return Calibration(made, data.get("robot") if "joints" in data else None)


def _from_schema_1(joint: Joint) -> Joint:
    """Return the joint of an old file: ranges of the encoder, and a zero in the offset."""
    sign = -1 if joint.drive_mode else 1
    zero = HALF_TURN - joint.homing_offset
    return replace(joint, drive_mode=0, homing_offset=0, zero=zero, sign=sign)


def _joint(entry: Any, place: str) -> Joint:
    fields = ("id", "drive_mode", "homing_offset", "range_min", "range_max")
    if not isinstance(entry, dict):
        raise RobotError(f"{place}: a joint's calibration is a table with {format_names(fields)}")
    for name in fields:
        value = entry.get(name)
        if not isinstance(value, int) or isinstance(value, bool):
            raise RobotError(f"{place}: {name} is {value!r}, not a whole number")
    if entry["drive_mode"] not in (0, 1):
        raise RobotError(f"{place}: drive_mode is {entry['drive_mode']}; expected 0 or 1")
    if entry["range_min"] >= entry["range_max"]:
        raise RobotError(f"{place}: range_min {entry['range_min']} is not below range_max")
    sign, zero, model = entry.get("sign", 1), entry.get("zero"), entry.get("model")
    if sign not in (1, -1):
        raise RobotError(f"{place}: sign is {sign!r}; expected 1 or -1")
    if zero is not None and (
        not isinstance(zero, int | float) or isinstance(zero, bool) or not math.isfinite(zero)
    ):
        raise RobotError(f"{place}: zero is {zero!r}, not a count")
    if not isinstance(model, str | None):
        raise RobotError(f"{place}: model is {model!r}, not the name of a servo's type")
    return Joint(**{name: entry[name] for name in fields}, model=model, zero=zero, sign=sign)
