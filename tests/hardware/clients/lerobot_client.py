"""LeRobot at a device file, run by the Python of LeRobot's own environment: nothing here is ours.

    python lerobot_client.py dynamixel DEVICE
    python lerobot_client.py feetech DEVICE

The first drives three XL330s as LeRobot's scripts do. The second sets an SO-101's calibration as
`lerobot-calibrate` does, drives its elbow, and writes one line of JSON: the calibration, and each
joint's angle in LeRobot's degrees.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from collections.abc import Callable
from typing import Any

from lerobot.motors import Motor, MotorNormMode  # type: ignore[import-not-found]
from lerobot.motors.dynamixel import DynamixelMotorsBus  # type: ignore[import-not-found]
from lerobot.motors.feetech import FeetechMotorsBus  # type: ignore[import-not-found]

RETRIES = 20  # a busy machine misses LeRobot's time limits
ARM = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")
TRAVEL, MIDDLE = 900, 2047  # counts: to either side of where the arm is held, and LeRobot's middle
DEGREES = MotorNormMode.DEGREES


def near(found: float, wanted: float, most: float) -> None:
    """Fail if a value is further than this from what it should be."""
    assert abs(found - wanted) <= most, (found, wanted)


def patiently(action: Callable[[], Any]) -> Any:
    """Do again what a busy machine may answer too late."""
    for _ in range(RETRIES - 1):
        try:
            return action()
        except ConnectionError:
            continue
    return action()


def new_servo(device: str) -> None:
    """A servo with another ID and speed is found and set up as `lerobot-setup-motors` does."""
    bus = DynamixelMotorsBus(port=device, motors={"hinge": Motor(7, "xl330-m288", DEGREES)})
    bus.setup_motor("hinge", initial_baudrate=1_000_000, initial_id=1)
    assert patiently(lambda: bus.ping("hinge")) == 1200
    bus.port_handler.closePort()


def dynamixel(device: str) -> None:
    """Set up, read, write, move, and switch off."""
    new_servo(device)
    motors = {name: Motor(n, "xl330-m288", DEGREES) for name, n in (("a", 7), ("b", 2), ("c", 3))}
    bus = DynamixelMotorsBus(port=device, motors=motors)
    patiently(bus.connect)
    assert patiently(lambda: bus.ping("b")) == 1200
    with bus.torque_disabled():
        bus.configure_motors()
        bus.write("Operating_Mode", "a", 4, num_retry=RETRIES)
    bus.write("Position_P_Gain", "a", 800, num_retry=RETRIES)
    assert bus.read("Position_P_Gain", "a", num_retry=RETRIES) == 800
    bus.enable_torque(num_retry=RETRIES)
    goals = {"a": 2348, "b": 2048, "c": 1948}
    bus.sync_write("Goal_Position", goals, normalize=False, num_retry=RETRIES)
    time.sleep(0.8)
    found = bus.sync_read("Present_Position", list(goals), normalize=False, num_retry=RETRIES)
    for name, goal in goals.items():
        near(found[name], goal, 60)
    bus.disable_torque(num_retry=RETRIES)
    torque = bus.sync_read("Torque_Enable", normalize=False, num_retry=RETRIES)
    assert set(torque.values()) == {0}
    bus.disconnect()


def feetech(device: str) -> None:
    """Calibrate as LeRobot does, drive the elbow, and tell what LeRobot reads."""
    motors = {name: Motor(n, "sts3215", DEGREES) for n, name in enumerate(ARM, 1)}
    bus = FeetechMotorsBus(port=device, motors=motors)
    patiently(bus.connect)
    bus.disable_torque(num_retry=RETRIES)
    bus.configure_motors()
    offsets = patiently(bus.set_half_turn_homings)
    for name, count in bus.sync_read("Present_Position", normalize=False).items():
        near(count, MIDDLE, 2)
        bus.write("Min_Position_Limit", name, MIDDLE - TRAVEL, num_retry=RETRIES)
        bus.write("Max_Position_Limit", name, MIDDLE + TRAVEL, num_retry=RETRIES)
    calibration = patiently(bus.read_calibration)
    assert {name: entry.homing_offset for name, entry in calibration.items()} == offsets
    bus.calibration = calibration
    bus.enable_torque(num_retry=RETRIES)
    bus.write("Goal_Position", "elbow_flex", 30.0, num_retry=RETRIES)
    time.sleep(1.5)
    angles = bus.sync_read("Present_Position", num_retry=RETRIES)
    near(angles["elbow_flex"], 30.0, 5.0)
    bus.disconnect(disable_torque=False)  # it holds its place while others look
    table = {name: dataclasses.asdict(entry) for name, entry in calibration.items()}
    sys.stdout.write(json.dumps({"calibration": table, "angles": angles}) + "\n")


if __name__ == "__main__":
    {"dynamixel": dynamixel, "feetech": feetech}[sys.argv[1]](sys.argv[2])
