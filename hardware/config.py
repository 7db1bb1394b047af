"""A robot's file: its model, servos, bus, limits and supply, checked.

    robot = load_robot("bench1")            # conf/robot/bench1.yaml, or a path
    robot.servos[0].id, robot.model, robot.bus.baud

The keys are explained where they are set, in `conf/robot/*.yaml`. Hydra reads the same files;
`make_robot` takes what it composed.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from hardware.assets import find_model
from hardware.errors import RobotError, did_you_mean, format_names
from hardware.parts import (
    IMUS,
    QUANTITIES,
    Bus,
    BusSettings,
    Imu,
    ImuErrors,
    Servo,
    Supply,
    shared_of_servos,
)
from hardware.robot import Robot, check_ports
from hardware.robot_checks import check_robot
from hardware.robot_files import ROBOTS as ROBOTS
from hardware.robot_files import find_robot, read_robot
from hardware.typed import mapping, parse_fields

NO_MODEL = Path("no model was given")


def load_robot(
    name_or_path: str | Path, model: str | None = None, needs_model: bool = True
) -> Robot:
    """Read a robot's YAML: a name of conf/robot, or a path.

    Names are looked up in the folder `robot` of the one that SIM2REAL_CONFIG_DIR names, too.

    Args:
        name_or_path: the robot.
        model: its MJCF, in place of the one that the file names.
        needs_model: whether a file that leaves the model open is refused.

    Raises:
        RobotError: there is no such robot, or its file is wrong; the message says file and key.
    """
    path = find_robot(name_or_path)
    data = read_robot(path)
    if model is not None:
        data["model"] = model
    return make_robot(data, str(path), needs_model)


def make_robot(data: Mapping[str, Any], place: str = "robot", needs_model: bool = True) -> Robot:
    """Build a robot from the keys of its file.

    Args:
        data: what YAML or Hydra read.
        place: the file's name, for messages.
        needs_model: whether a model that is left open (null) is refused; else it is NO_MODEL.

    Raises:
        RobotError: a key is missing, unknown or has a wrong value.
    """
    ports = data.get("port") if isinstance(data, Mapping) else None
    several = isinstance(data, Mapping) and "buses" in data
    data = _with_first_bus(data, place) if several else mapping(data, place)
    shared = shared_of_servos(data.get("servo"), f"{place}: servo")
    values = parse_fields(Robot, {k: v for k, v in data.items() if k != "servo"}, place)
    open_model = values["model"] is None and not needs_model
    values["model"] = NO_MODEL if open_model else find_model(values["model"], f"{place}: model")
    if not several:
        values["bus"] = BusSettings(**parse_fields(BusSettings, values["bus"], f"{place}: bus"))
    values["supply"] = _supply(values["supply"], f"{place}: supply")
    if values.get("imu") is not None:
        values["imu"] = _imu(values["imu"], f"{place}: imu")
    values["hidden"] = None if values.get("hidden") is None else Path(values["hidden"])
    values["servos"] = tuple(
        _servo({"name": name, **shared, **mapping(entry, place)}, f"{place}: servos.{name}")
        for name, entry in mapping(values["servos"], f"{place}: servos").items()
    )
    robot = Robot(**values)
    robot = robot.at(ports) if ports is not None else robot
    check_robot(robot, place)
    return robot


def _with_first_bus(data: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Return the keys of a robot of several buses, their settings read."""
    if "bus" in data:
        raise RobotError(f"{place}: it has both bus and buses; give one")
    table = mapping(data["buses"], f"{place}: buses")
    buses = tuple(
        Bus(
            **parse_fields(
                Bus, {"name": str(name), **mapping(entry, place)}, f"{place}: buses.{name}"
            )
        )
        for name, entry in table.items()
    )
    if not buses:
        raise RobotError(f"{place}: buses: expected at least one")
    check_ports(buses, f"{place}: buses")
    return {**data, "buses": buses, "bus": buses[0], "port": buses[0].port}


def _servo(data: Mapping[str, Any], place: str) -> Servo:
    values = parse_fields(Servo, data, place)
    if values.get("supply") is not None:
        values["supply"] = _supply(values["supply"], f"{place}: supply")
    return Servo(**values)


def _supply(data: Any, place: str) -> Supply:
    supply = Supply(**parse_fields(Supply, data, place))
    if not supply.voltage > 0:
        raise RobotError(f"{place}.voltage: {supply.voltage} is not above 0")
    if not supply.resistance >= 0:
        raise RobotError(f"{place}.resistance: {supply.resistance} is below 0")
    return supply


def _imu(data: Any, place: str) -> Imu:
    values = parse_fields(Imu, data, place)
    if "emulated" in values:
        values["emulated"] = _imu_errors(values["emulated"], f"{place}: emulated")
    imu = Imu(**values)
    if imu.model not in IMUS:
        hint = did_you_mean(imu.model, IMUS)
        raise RobotError(f"{place}: model: unknown part {imu.model!r}{hint}: {format_names(IMUS)}")
    length = math.sqrt(sum(part**2 for part in imu.mount))
    if abs(length - 1) > 1e-3:
        raise RobotError(f"{place}: mount: {list(imu.mount)} is not a unit quaternion w x y z")
    w, x, y, z = (part / length for part in imu.mount)
    return replace(imu, mount=(w, x, y, z))


def _imu_errors(data: Any, place: str) -> ImuErrors:
    values = parse_fields(ImuErrors, data, place)
    measures = values.get("measures", ImuErrors.measures)
    if not isinstance(measures, list | tuple) or not set(measures) <= set(QUANTITIES):
        raise RobotError(
            f"{place}: measures: {measures!r}; it is a list of {format_names(QUANTITIES)}, of "
            f"which each "
            "may be left out"
        )
    errors = ImuErrors(**{**values, "measures": tuple(measures)})
    for key in ("orientation_noise", "gyro_noise", "acceleration_noise", "latency"):
        if not getattr(errors, key) >= 0:
            raise RobotError(f"{place}: {key}: {getattr(errors, key)} is below 0")
    return errors
