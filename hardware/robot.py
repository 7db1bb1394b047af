"""A robot as its file describes it: servos, buses, supplies and limits.

robot = load_robot("bench1")            # hardware/config.py
robot.servo("hinge").id, robot.parts(), robot.at("/dev/ttyUSB0")
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from hardware.errors import RobotError, did_you_mean, format_names
from hardware.parts import Bus, BusSettings, Imu, Servo, Supply

PORT = "give a port such as /dev/ttyUSB0, or leave it out for the emulated robot"
WATCHDOG_STEP = 0.02  # s, the unit of the watchdog's register
LIMITING = {"dynamixel": "goal_pwm", "feetech": "torque_limit"}  # registers that limit the duty


@dataclass(frozen=True)
class Robot:
    """A robot as its file describes it; `conf/robot/bench1.yaml` explains every key.

    The file's key `servo` holds what its servos share; each may say otherwise.
    """

    name: str  # carried by calibration files and logs
    model: Path  # its MJCF
    servos: tuple[Servo, ...]  # the servos, in the order of the file
    registers: Mapping[str, int]  # written to every servo before its torque goes on, raw values
    bus: BusSettings  # the serial bus; of several the first
    rate: float  # control steps a second
    command_delay: float  # the time from writing a command to its effect [s]
    reading_age: float  # the time from a reading to writing the command computed from it [s]
    max_step: float  # largest change of a command in one control step [rad]
    watchdog: float  # the servos stop after this long without a command [s]
    supply: Supply  # the power supply of the servos without a separate one
    port: str | None = None  # the serial port, None for the emulated bus; of several the first
    hidden: Path | None = None  # a file of effects that the emulated robot hides, or None
    buses: tuple[Bus, ...] = ()  # the buses, where there are several
    imu: Imu | None = None  # the IMU, or None

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
            RobotError: more or fewer ports than buses, one twice, or an empty one.
        """
        given = [ports] if ports is None or isinstance(ports, str) else list(ports)
        if "" in given:
            raise RobotError(f"{self.name}: port= is empty; {PORT}")
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
        check_ports(buses, self.name)
        return replace(self, buses=tuple(buses), port=buses[0].port)

    def with_imu_at(self, port: str) -> Robot:
        """Return the robot with its IMU at a port.

        Raises:
            RobotError: its file names no IMU, or the port is that of a bus.
        """
        if not port:
            raise RobotError(f"{self.name}: imu_port= is empty; {PORT}")
        if self.imu is None:
            raise RobotError(f"{self.name}: imu_port={port}, but its file names no IMU (key imu)")
        if port in [bus.port for bus in self.buses] + [self.port]:
            raise RobotError(f"{self.name}: imu_port={port} is the port of its servos")
        return replace(self, imu=replace(self.imu, port=port))

    def bus_of(self, servo: Servo) -> BusSettings:
        """Return the bus that a servo is on."""
        return next((bus for bus in self.buses if bus.name == servo.bus), self.bus)

    def supply_of(self, servo: Servo) -> Supply:
        """Return the power supply of a servo."""
        return servo.supply or self.supply

    def mode_of(self, servo: Servo) -> int:
        """Return the operating mode that a servo has once the robot is set up."""
        return self.registers_of(servo).get("operating_mode", servo.type.position_mode)

    @property
    def watchdog_steps(self) -> int:
        """The watchdog in steps of 20 ms, rounded up; 0 for none."""
        return math.ceil(round(self.watchdog / WATCHDOG_STEP, 6))

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
            part = servo.torque / servo.type.stall_torque(self.supply_of(servo).voltage)
            values[LIMITING[servo.type.maker]] = round(servo.type.units.full_pwm * min(part, 1.0))
        return values


def check_ports(buses: Sequence[Bus], place: str) -> None:
    """Refuse ports that are given twice, or not for all buses, with a RobotError."""
    ports = [bus.port for bus in buses]
    if None in ports and any(ports):
        missing = format_names(bus.name for bus in buses if bus.port is None)
        raise RobotError(f"{place}: no port for {missing}; give one for each bus, or for none")
    if len(set(ports)) < len(ports) and None not in ports:
        raise RobotError(f"{place}: {format_names(map(str, ports))}: each bus needs its own port")
