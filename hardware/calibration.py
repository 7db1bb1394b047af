"""Where each joint's zero is, which way it counts, and how far it may go: one JSON file a robot.

    write_calibration("bench1.json", calibration_of(robot))
    robot = apply_calibration(robot, read_calibration("bench1.json"))

The file has `schema`, `robot`, `date` and `joints`: `id`, `model`, `drive_mode` (1: counts down
where the angle grows), `homing_offset` (2048 less the count at the joint's zero), `range_min` and
`range_max` (counts). A file of LeRobot, the joints' table alone and without `model`, is read too.
Nothing of it is written into servos: their own homing offset stays 0.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hardware.config import Robot
from hardware.errors import RobotError, did_you_mean, listed
from hardware.files import whole_file

SCHEMA = 1
HALF_TURN = 2048


@dataclass(frozen=True)
class Joint:
    """One joint's calibration, in counts of its encoder; `model` is None if it is not known."""

    id: int
    drive_mode: int
    homing_offset: int
    range_min: int
    range_max: int
    model: str | None = None


@dataclass(frozen=True)
class Calibration:
    """The joints' calibration by actuator, and the robot it was made on (None: not known)."""

    joints: Mapping[str, Joint]
    robot: str | None = None


def calibration_of(robot: Robot) -> Calibration:
    """Return what a robot's own file says, as a calibration."""
    joints = {}
    for servo in robot.servos:
        ends = sorted(servo.count(angle) for angle in servo.position)
        offset = HALF_TURN - servo.zero
        reverse = int(servo.sign < 0)
        joints[servo.name] = Joint(servo.id, reverse, offset, *ends, model=servo.model)
    return Calibration(joints, robot.name)


def apply_calibration(robot: Robot, calibration: Calibration) -> Robot:
    """Return the robot with the calibration's signs and zeros, and limits within both.

    Raises:
        RobotError: it is another robot's: other names, IDs or servo types.
    """
    if calibration.robot not in (None, robot.name):
        raise RobotError(
            f"this calibration was made on {calibration.robot!r}, not on {robot.name!r}; "
            "calibrate this robot: python -m hardware calibrate"
        )
    unknown = [name for name in calibration.joints if name not in robot.names]
    missing = [name for name in robot.names if name not in calibration.joints]
    if unknown or missing:
        name = (unknown or missing)[0]
        hint = did_you_mean(name, robot.names if unknown else calibration.joints)
        what = "has the joint" if unknown else "lacks the joint"
        raise RobotError(
            f"the calibration {what} {name!r}{hint}; {robot.name} has {listed(robot.names)}"
        )
    servos = []
    for servo in robot.servos:
        joint = calibration.joints[servo.name]
        if joint.id != servo.id or joint.model not in (None, servo.model):
            raise RobotError(
                f"the calibration of {servo.name!r} is of servo {joint.id} ({joint.model}), "
                f"the robot has servo {servo.id} ({servo.model})"
            )
        sign = -1 if joint.drive_mode else 1
        turned = replace(servo, sign=sign, zero=HALF_TURN - joint.homing_offset)
        ends = sorted((turned.angle(joint.range_min), turned.angle(joint.range_max)))
        low, high = max(ends[0], servo.position[0]), min(ends[1], servo.position[1])
        if low >= high:
            raise RobotError(
                f"{servo.name!r}: its calibrated range [{ends[0]:.3f}, {ends[1]:.3f}] rad and the "
                f"robot's {list(servo.position)} have nothing in common"
            )
        servos.append(replace(turned, position=(low, high)))
    return replace(robot, servos=tuple(servos))


def write_calibration(path: str | Path, calibration: Calibration) -> None:
    """Write the file, whole or not at all."""
    data = {
        "schema": SCHEMA,
        "robot": calibration.robot,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "joints": {name: asdict(joint) for name, joint in calibration.joints.items()},
    }
    with whole_file(Path(path)) as temporary:
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
    if data.get("schema", SCHEMA) != SCHEMA:
        raise RobotError(
            f"{path}: schema {data['schema']!r} is unknown; this program reads {SCHEMA}"
        )
    joints = data.get("joints", data)
    made = {name: _joint(entry, f"{path}: {name}") for name, entry in joints.items()}
    return Calibration(made, data.get("robot") if "joints" in data else None)


def _joint(entry: Any, place: str) -> Joint:
    fields = ("id", "drive_mode", "homing_offset", "range_min", "range_max")
    if not isinstance(entry, dict):
        raise RobotError(f"{place}: a joint's calibration is a table with {listed(fields)}")
    for name in fields:
        value = entry.get(name)
        if not isinstance(value, int) or isinstance(value, bool):
            raise RobotError(f"{place}: {name} is {value!r}, not a whole number")
    if entry["range_min"] >= entry["range_max"]:
        raise RobotError(f"{place}: range_min {entry['range_min']} is not below range_max")
    return Joint(**{name: entry[name] for name in fields}, model=entry.get("model"))
