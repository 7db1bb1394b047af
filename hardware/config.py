"""A robot's file: its model, servos, bus, limits and supply, checked.

    robot = load_robot("bench1")            # conf/robot/bench1.yaml, or a path
    robot.servos[0].id, robot.model, robot.bus.baud

The keys are explained where they are set, in `conf/robot/*.yaml`. Hydra reads the same files;
`make_robot` takes what it composed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
from hardware.reach import check_reach
from hardware.robot_files import ROBOTS as ROBOTS
from hardware.robot_files import find_robot, read_robot
from hardware.typed import mapping, parse_fields

NO_MODEL = Path("no model was given")
LIMITING = {"dynamixel": "goal_pwm", "feetech": "torque_limit"}  # registers that limit the duty


@dataclass(frozen=True)
class Robot:
    """A robot as its file describes it; `conf/robot/bench1.yaml` explains every key.

    The file's key `servo` holds what its servos share; each may say otherwise.

    Args:
        name: carried by calibration files and logs.
        model: its MJCF.
        servos: the servos, in the order of the file.
        registers: written to every servo before its torque goes on, raw values.
        bus: the serial bus; of several the first.
        rate: control steps a second.
        command_delay: the time from writing a command to its effect [s].
        reading_age: the time from a reading to writing the command computed from it [s].
        max_step: largest change of a command in one control step [rad].
        watchdog: the servos stop after this long without a command [s].
        supply: the power supply.
        port: the serial port, None for the emulated bus; of several the first.
        hidden: a file of effects that the emulated robot hides, or None.
        buses: the buses, where there are several.
        imu: the IMU, or None.
    """

    name: str
    model: Path
    servos: tuple[Servo, ...]
    registers: Mapping[str, int]
    bus: BusSettings
    rate: float
    command_delay: float
    reading_age: float
    max_step: float
    watchdog: float
    supply: Supply
    port: str | None = None
    hidden: Path | None = None
    buses: tuple[Bus, ...] = ()
    imu: Imu | None = None

    def parts(self) -> list[Robot]:
        """Return the robot bus by bus: each part's servos are on one bus, and of one maker."""
        if not self.buses:
            return [self]
        parts = []
        for bus in self.buses:
            servos = tuple(servo for servo in self.servos if servo.bus == bus.name)
            name = f"{self.name}, bus {bus.name}"
            part = replace(self, name=name, servos=servos, bus=bus, port=bus.port, buses=())
            stops = any(servo.type.maker != "feetech" for servo in servos)
            parts.append(part if stops else replace(part, watchdog=0.0))
        return parts

    def at(self, ports: str | Sequence[str] | None) -> Robot:
        """Return the robot at other ports: one for each bus in their order, None for emulated ones.

        Raises:
            RobotError: more or fewer ports than buses, or one twice.
        """
        given = [ports] if ports is None or isinstance(ports, str) else list(ports)
        if not self.buses and len(given) == 1:
            return replace(self, port=given[0])
        if ports is None:
            given = [None] * len(self.buses)
        if len(given) != max(len(self.buses), 1):
            names = f" ({format_names(bus.name for bus in self.buses)})" if self.buses else ""
            raise RobotError(
                f"{self.name}: port: {format_names(map(str, given))} for {max(len(self.buses), 1)} "
                f"buses{names}; each has one, in this order"
            )
        buses = [replace(b, port=port) for b, port in zip(self.buses, given, strict=True)]
        _check_ports(buses, self.name)
        return replace(self, buses=tuple(buses), port=buses[0].port)

    def with_imu_at(self, port: str) -> Robot:
        """Return the robot with its IMU at a port.

        Raises:
            RobotError: its file names no IMU, or the port is that of a bus.
        """
        if self.imu is None:
            raise RobotError(f"{self.name}: imu_port={port}, but its file names no IMU (key imu)")
        if port in [bus.port for bus in self.buses] + [self.port]:
            raise RobotError(f"{self.name}: imu_port={port} is the port of its servos")
        return replace(self, imu=replace(self.imu, port=port))

    def bus_of(self, servo: Servo) -> BusSettings:
        """Return the bus that a servo is on."""
        return next((bus for bus in self.buses if bus.name == servo.bus), self.bus)

    @property
    def maker(self) -> str:
        """The maker of its servos, as far as they are on one bus."""
        return self.servos[0].type.maker

    @property
    def names(self) -> list[str]:
        """The actuators, in order."""
        return [servo.name for servo in self.servos]

    def servo(self, name: str) -> Servo:
        """Return the servo of this actuator.

        Raises:
            RobotError: the robot has no such actuator.
        """
        for servo in self.servos:
            if servo.name == name:
                return servo
        hint = did_you_mean(name, self.names)
        raise RobotError(
            f"{self.name} has no servo {name!r}{hint}; it has {format_names(self.names)}"
        )

    def registers_of(self, servo: Servo) -> dict[str, int]:
        """Return the registers to write to this servo: the robot's, then its own.

        A limit of torque becomes one of PWM: the part of the supply that stalls at that torque.
        """
        values = {**self.registers, **servo.registers}
        if servo.torque is not None:
            part = servo.torque / servo.type.stall_torque(self.supply.voltage)
            values[LIMITING[servo.type.maker]] = round(servo.type.units.full_pwm * min(part, 1.0))
        return values


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
    values["supply"] = Supply(**parse_fields(Supply, values["supply"], f"{place}: supply"))
    if values.get("imu") is not None:
        values["imu"] = _imu(values["imu"], f"{place}: imu")
    values["hidden"] = None if values.get("hidden") is None else Path(values["hidden"])
    values["servos"] = tuple(
        Servo(
            **parse_fields(
                Servo, {"name": name, **shared, **mapping(entry, place)}, f"{place}: servos.{name}"
            )
        )
        for name, entry in mapping(values["servos"], f"{place}: servos").items()
    )
    robot = Robot(**values)
    robot = robot.at(ports) if ports is not None else robot
    _check(robot, place)
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
        raise RobotError(f"{place}: buses: there is at least one")
    _check_ports(buses, f"{place}: buses")
    return {**data, "buses": buses, "bus": buses[0], "port": buses[0].port}


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
        raise RobotError(f"{place}: mount: {list(imu.mount)} is no unit quaternion w x y z")
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


def _check_ports(buses: Sequence[Bus], place: str) -> None:
    """Refuse ports that are given twice, or not for all buses."""
    ports = [bus.port for bus in buses]
    if None in ports and any(ports):
        missing = format_names(bus.name for bus in buses if bus.port is None)
        raise RobotError(f"{place}: no port for {missing}; give one for each bus, or for none")
    if len(set(ports)) < len(ports) and None not in ports:
        raise RobotError(
            f"{place}: {format_names(map(str, ports))}: each bus has a port of its own"
        )


def _check(robot: Robot, place: str) -> None:
    if not robot.servos:
        raise RobotError(f"{place}: servos: a robot has at least one")
    for servo in robot.servos:
        _check_servo(robot, servo, f"{place}: servos.{servo.name}")
    for part in robot.parts():
        _check_bus(part, place)
    positive = {
        "rate": robot.rate,
        "max_step": robot.max_step,
        "supply.voltage": robot.supply.voltage,
    }
    for key, value in positive.items():
        if not value > 0:
            raise RobotError(f"{place}: {key}: {value} is not above 0")
    at_least_0 = {
        "command_delay": robot.command_delay,
        "reading_age": robot.reading_age,
        "supply.resistance": robot.supply.resistance,
    }
    for key, value in at_least_0.items():
        if not value >= 0:
            raise RobotError(f"{place}: {key}: {value} is below 0")
    if {servo.type.maker for servo in robot.servos} == {"feetech"} and robot.watchdog:
        raise RobotError(f"{place}: watchdog: {robot.watchdog} s; Feetech servos have none: give 0")
    if not 0 <= robot.watchdog <= 2.54:
        raise RobotError(f"{place}: watchdog: {robot.watchdog} s; it can be 0 (off) to 2.54 s")


def _check_bus(part: Robot, place: str) -> None:
    """Check the servos and settings of one bus."""
    bus = part.bus
    key = f"{place}: buses.{bus.name}" if isinstance(bus, Bus) else f"{place}: bus"
    if not part.servos:
        raise RobotError(f"{key}: it has no servo; each servo's key bus names its own")
    ids = [servo.id for servo in part.servos]
    for servo in part.servos:
        if ids.count(servo.id) > 1:
            raise RobotError(
                f"{place}: servos.{servo.name}: id {servo.id} is taken; each has its own on its bus"
            )
    makers = {servo.type.maker for servo in part.servos}
    if len(makers) > 1:
        raise RobotError(
            f"{key}: servos of {format_names(sorted(makers))} on one bus; each has its own"
        )
    bauds = part.servos[0].type.bauds
    if bus.baud not in bauds:
        raise RobotError(f"{key}.baud: {bus.baud} is not one of {bauds}")
    for name in ("return_delay", "latency"):
        if not getattr(bus, name) >= 0:
            raise RobotError(f"{key}.{name}: {getattr(bus, name)} is below 0")


def _check_servo(robot: Robot, servo: Servo, place: str) -> None:
    kind = servo.type
    names = [bus.name for bus in robot.buses] or [None]
    if servo.bus not in names:
        remedy = f"give one of {format_names(map(str, names))}" if robot.buses else "leave it out"
        raise RobotError(f"{place}: bus {servo.bus!r}: the robot has no such bus; {remedy}")
    if not 0 <= servo.id <= 251:
        raise RobotError(f"{place}: id {servo.id}; it can be 0 to 251")
    if servo.sign not in (1, -1):
        raise RobotError(f"{place}: sign {servo.sign}; it can be 1 or -1")
    if not abs(servo.zero) <= 2 * kind.units.counts_per_turn:
        raise RobotError(
            f"{place}: zero {servo.zero:g}; a turn of its encoder has {kind.units.counts_per_turn} "
            "counts, and the zero is within two turns"
        )
    low, high = servo.position
    if not low < high:
        raise RobotError(f"{place}: position [{low}, {high}]: the first must be below the second")
    check_reach(servo, robot.registers_of(servo), place)
    if not servo.velocity > 0:
        raise RobotError(f"{place}: velocity {servo.velocity} rad/s is not above 0")
    if servo.torque is not None and not servo.torque > 0:
        raise RobotError(f"{place}: torque {servo.torque} N·m is not above 0; null means no limit")
    _check_effort(servo, place)
    for name, value in robot.registers_of(servo).items():
        register = kind.register(name)
        if not register.writable:
            raise RobotError(f"{place}: registers: {name!r} can only be read")
        low, high = register.fixed_range
        if not low <= value <= high:
            raise RobotError(f"{place}: registers: {name} = {value}; it can be {low} to {high}")


def _check_effort(servo: Servo, place: str) -> None:
    """Check the limit of current or of load, whichever the servo reports."""
    reports = "load" if servo.type.current is None else "current"
    other = "current" if reports == "load" else "load"
    if getattr(servo, other) is not None:
        raise RobotError(f"{place}: {other}: a {servo.model} reports its {reports}; give {reports}")
    value = getattr(servo, reports)
    if value is not None and not 0 < value <= (1.0 if reports == "load" else math.inf):
        raise RobotError(f"{place}: {reports} {value}; it is above 0, a load at most 1")
