"""From servos on a desk to a robot's file: IDs, then each joint by hand, then the YAML.

    make_robot_file("/dev/ttyUSB0", Path("arm.xml"), Path("my_arm.yaml"), ask_terminal, print)

The model says which joints there are: one actuator for each servo. A joint that is moved by hand
says which servo turns it, and takes its limits, zero and direction with it. The file is written
last, atomically.
"""

import math
import os
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import yaml

from hardware.by_hand import HandMeasurement, Travel
from hardware.command_line import UsageError
from hardware.config import Robot, Servo, make_robot
from hardware.connect import DRIVERS, make_driver, patient
from hardware.detected import client_of, detected_servo, robot_of, scan_port
from hardware.driver import Driver
from hardware.errors import RobotError, ServoError, format_names
from hardware.files import atomic_write, check_new
from hardware.parts import BusSettings
from hardware.robot_files import SUFFIXES
from hardware.scan import DetectedServo
from hardware.setup import set_up, write_differences
from hardware.terminal import Ask, Tell

BAUD = 1_000_000
RATE = 50.0  # control steps a second, at most
BUSY_PART = 0.7  # of a control step, that the bus may take
SLOWER = 0.6  # of the speed without load, the fastest motion that is commanded
WATCHDOG = 0.1  # s, where the servos have one
HEAD = "# Made by python -m hardware setup; conf/robot/bench1.yaml explains every key.\n"


def make_robot_file(port: str, model: Path, path: Path, ask: Ask, tell: Tell) -> None:
    """Set servos up, measure their joints by hand, and write the robot's file.

    Args:
        port: the serial port of all the servos.
        model: the robot's MJCF.
        path: the file to write, `.yaml`.
        ask: asks the person.
        tell: shows a line.

    Raises:
        UsageError: no one answers, it was interrupted, or the file ends in something else; it is
            not written.
        RobotError: the model has no actuators, or the file is there already.
        HardwareError: the servos are not there, or are not what they must be.
    """
    names = actuators(model)
    if path.suffix not in SUFFIXES:
        raise UsageError(f"file={path}: a robot's file ends in .yaml")
    check_new(path)
    try:
        draft = _with_ids(names, port, ask, tell)
        driver = make_driver(draft)
        try:
            driver.connect()
            driver.torque_off()
            with patient(driver):
                joints = _joints(driver, names, ask, tell)
                data = _described(driver, joints, model, path)
        finally:
            driver.close()
    except EOFError:
        raise UsageError(f"this needs a person at a terminal; {path} was not written") from None
    except KeyboardInterrupt:
        raise UsageError(f"interrupted; {path} was not written") from None
    make_robot({**data, "model": str(model)}, str(path))
    text = HEAD + yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=140)
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    tell(f"wrote {path}; next: python -m hardware scan robot={path}")


def actuators(model: Path) -> list[str]:
    """Return the actuators of an MJCF, in order; raises RobotError if it has none."""
    try:
        compiled = mujoco.MjModel.from_xml_path(str(model))
    except (ValueError, mujoco.FatalError) as error:
        raise RobotError(f"{model}: this model does not compile: {error}") from None
    if not compiled.nu:
        raise RobotError(
            f"{model} has no actuators; give it one for each servo, named as its joint"
        )
    return [compiled.actuator(i).name for i in range(compiled.nu)]


def _with_ids(names: Sequence[str], port: str, ask: Ask, tell: Tell) -> Robot:
    """Return the robot of the servos at a port once each has an ID of its own and one speed."""
    found = _seen(port, tell)
    if len(found) != len(names) or any(servo.shared for servo in found):
        found = _one_by_one(names, port, ask, tell)
    draft = robot_of(found, port)
    draft = replace(draft, bus=BusSettings(BAUD, 0.0, draft.bus.latency))
    client = client_of(port, draft.maker)
    try:
        set_up(draft, client, ask, tell)
    finally:
        client.close()
    return draft


def _seen(port: str, tell: Tell, makers: Iterable[str] = tuple(DRIVERS)) -> list[DetectedServo]:
    found = list(scan_port(port, makers))
    for servo in found:
        tell(str(servo))
    return found


def _one_by_one(names: Sequence[str], port: str, ask: Ask, tell: Tell) -> list[DetectedServo]:
    """Give the servos their IDs, each connected alone, and return them all connected."""
    tell(f"the model has {len(names)} actuators: give each servo its ID, one after the other")
    makers: Iterable[str] = tuple(DRIVERS)
    for number, name in enumerate(names, 1):
        [found] = _wait_for(1, f"connect the servo of {name} alone", port, makers, ask, tell)
        makers = (found.maker,)
        _give_id(replace(detected_servo(name, found), id=number), found, port, ask, tell)
    return _wait_for(len(names), "connect all servos", port, makers, ask, tell)


def _wait_for(
    count: int, what: str, port: str, makers: Iterable[str], ask: Ask, tell: Tell
) -> list[DetectedServo]:
    """Ask until a number of servos answers."""
    while True:
        ask(f"{what}, then press Enter ")
        found = _seen(port, tell, makers)
        if len(found) == count and not any(servo.shared for servo in found):
            return found
        tell(f"{len(found)} IDs answer; this needs {count} servos, each with its own")


def _give_id(servo: Servo, found: DetectedServo, port: str, ask: Ask, tell: Tell) -> None:
    """Write a servo's ID and speed."""
    alone = robot_of([found], port)
    bus = BusSettings(BAUD, 0.0, alone.bus.latency)
    alone = replace(alone, servos=(servo,), bus=bus)
    client = client_of(port, found.maker)
    try:
        with client.more_patient():
            write_differences(alone, client, [servo], {servo.name: found}, ask, tell)
    finally:
        client.close()


def _joints(
    driver: Driver, names: Sequence[str], ask: Ask, tell: Tell
) -> dict[str, tuple[Servo, Travel]]:
    """Return which servo turns each joint, and how."""
    hand, left, joints = HandMeasurement(driver, ask), list(range(len(names))), {}
    for name in names:
        i = hand.which(name, left) if len(left) > 1 else left[0]
        left.remove(i)
        servo = driver.robot.servos[i]
        joints[name] = servo, hand.measure(i, name)
        travel = joints[name][1]
        tell(
            f"{name}: servo {servo.id}, {travel.high - travel.low:.2f} rad of travel, "
            f"sign {travel.sign:+d}"
        )
    return joints


def _described(
    driver: Driver, joints: dict[str, tuple[Servo, Travel]], model: Path, path: Path
) -> dict[str, Any]:
    """Return the content of the robot's file."""
    robot = driver.robot
    bus, maker = robot.bus, robot.maker
    volts = round(_supply(driver), 1)
    return {
        "name": path.stem,
        "model": os.path.relpath(model, path.parent),
        "servos": {
            name: {
                "id": servo.id,
                "model": servo.model,
                "sign": travel.sign,
                "zero": servo.count(travel.zero),
                "position": _limits(travel),
                "velocity": round(SLOWER * volts / servo.type.torque_constant, 1),
            }
            for name, (servo, travel) in joints.items()
        },
        "registers": {},
        "bus": {"baud": bus.baud, "return_delay": 0.0, "latency": bus.latency},
        "rate": min(RATE, float(int(BUSY_PART / driver.cycle_time()))),
        "command_delay": 0.001,
        "reading_age": round(driver.cycle_time() / 2, 4),
        "max_step": 0.2,
        "watchdog": WATCHDOG if maker == "dynamixel" else 0.0,
        "supply": {"voltage": volts},
        "port": robot.port,
        "hidden": None,
    }


def _supply(driver: Driver) -> float:
    """Return the voltage that the servos measure [V].

    Raises:
        ServoError: a servo does not tell it.
    """
    health = [driver.health(i) for i in range(len(driver))]
    voltages = [each.voltage for each in health if each is not None]
    if not voltages:
        raise ServoError(f"no servo reports its voltage: {format_names(driver.robot.names)}")
    return statistics.median(voltages)


def _limits(travel: Travel) -> list[float]:
    """Return the least and the largest angle from the zero [rad], rounded inwards."""
    ends = sorted(travel.sign * (end - travel.zero) for end in (travel.low, travel.high))
    return [math.ceil(100 * ends[0]) / 100, math.floor(100 * ends[1]) / 100]
