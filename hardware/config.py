"""A robot's file: its model, servos, bus, limits and supply, checked.

    robot = load_robot("bench1")            # conf/robot/bench1.yaml, or a path
    robot.servos[0].id, robot.model, robot.bus.baud

The keys are explained where they are set, in `conf/robot/*.yaml`. Hydra reads the same files;
`make_robot` takes what it composed.
"""

from __future__ import annotations

import os
import types
import typing
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields
from pathlib import Path
from typing import Any

import yaml

from hardware.errors import RobotError, did_you_mean, listed
from hardware.tables import ServoType, servo_type

ROOT = Path(__file__).parents[1]
ROBOTS = ROOT / "conf" / "robot"
ASSETS = ROOT / "envs" / "assets"
NO_MODEL = Path("no model was given")


LIMITING = {"dynamixel": "goal_pwm", "feetech": "torque_limit"}  # registers that limit the duty


@dataclass(frozen=True)
class Servo:
    """One servo of a robot and the joint it turns.

    Args:
        name: the actuator of the model that it stands for.
        id: its number on the bus, 0 to 251.
        model: its type.
        sign: 1 or -1: the direction of its counts along the joint.
        zero: the count at the joint's zero; a calibration may put it between two.
        position: least and largest angle to command [rad].
        velocity: fastest motion of a command [rad/s].
        torque: largest torque [N·m], None for all it has.
        registers: registers of this servo beside the robot's.
    """

    name: str
    id: int
    model: str
    sign: int
    zero: float
    position: tuple[float, float]
    velocity: float
    torque: float | None
    registers: Mapping[str, int] = field(default_factory=dict)

    @property
    def type(self) -> ServoType:
        """Its type's data."""
        return servo_type(self.model)

    def angle(self, count: float) -> float:
        """Return the joint's angle [rad] at this count of the encoder."""
        return self.sign * (count - self.zero) * self.type.units.angle

    def count(self, angle: float) -> int:
        """Return the nearest count of the encoder at this angle [rad]."""
        return round(self.zero + self.sign * angle / self.type.units.angle)


@dataclass(frozen=True)
class BusSettings:
    """The serial bus: baud [bits/s], return_delay [s], latency of the USB adapter [s]."""

    baud: int
    return_delay: float
    latency: float


@dataclass(frozen=True)
class Supply:
    """The power supply: voltage without load [V], inner resistance [ohm]."""

    voltage: float
    resistance: float


@dataclass(frozen=True)
class Robot:
    """A robot as its file describes it; `conf/robot/bench1.yaml` explains every key.

    Args:
        name: carried by calibration files and logs.
        model: its MJCF.
        servos: in the order of the file.
        registers: written to every servo before its torque goes on, raw values.
        bus: the serial bus.
        rate: control steps a second.
        command_delay: from writing a command to its effect [s].
        reading_age: from a reading to writing the command made of it [s].
        max_step: largest change of a command in one control step [rad].
        watchdog: the servos stop after this long without a command [s].
        supply: the power supply.
        port: the serial port, None for the emulated bus.
        hidden: a file of effects that the emulated robot hides, or None.
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
        raise RobotError(f"{self.name} has no servo {name!r}{hint}; it has {listed(self.names)}")

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
    path = Path(name_or_path)
    own = os.environ.get("SIM2REAL_CONFIG_DIR")
    places = [ROBOTS, *([Path(own) / "robot"] if own else [])]
    files = {file.stem: file for place in places for file in place.glob("*.yaml")}
    if path.suffix not in (".yaml", ".yml"):
        path = files.get(str(name_or_path), ROBOTS / f"{name_or_path}.yaml")
    if not path.is_file():
        known = sorted(files)
        hint = did_you_mean(str(name_or_path), known)
        raise RobotError(f"there is no robot {str(name_or_path)!r}{hint}; known: {listed(known)}")
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except yaml.YAMLError as error:
        raise RobotError(f"{path}: this cannot be read as YAML: {error}") from None
    if model is not None:
        data = {**_mapping(data, str(path)), "model": model}
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
    values = _fields(Robot, data, place)
    open_model = values["model"] is None and not needs_model
    values["model"] = NO_MODEL if open_model else _model(values["model"], f"{place}: model")
    values["bus"] = BusSettings(**_fields(BusSettings, values["bus"], f"{place}: bus"))
    values["supply"] = Supply(**_fields(Supply, values["supply"], f"{place}: supply"))
    values["hidden"] = None if values.get("hidden") is None else Path(values["hidden"])
    values["servos"] = tuple(
        Servo(**_fields(Servo, {"name": name, **_mapping(entry, place)}, f"{place}: servos.{name}"))
        for name, entry in _mapping(values["servos"], f"{place}: servos").items()
    )
    robot = Robot(**values)
    _check(robot, place)
    return robot


def _check(robot: Robot, place: str) -> None:
    if not robot.servos:
        raise RobotError(f"{place}: servos: a robot has at least one")
    for servo in robot.servos:
        _check_servo(robot, servo, f"{place}: servos.{servo.name}")
    ids = [servo.id for servo in robot.servos]
    for servo in robot.servos:
        if ids.count(servo.id) > 1:
            raise RobotError(
                f"{place}: servos.{servo.name}: id {servo.id} is taken; each has its own"
            )
    bauds = servo_type(robot.servos[0].model).bauds
    if robot.bus.baud not in bauds:
        raise RobotError(f"{place}: bus.baud: {robot.bus.baud} is not one of {bauds}")
    positive = {
        "rate": robot.rate,
        "max_step": robot.max_step,
        "supply.voltage": robot.supply.voltage,
    }
    for key, value in positive.items():
        if not value > 0:
            raise RobotError(f"{place}: {key}: {value} is not above 0")
    at_least_0 = {
        "bus.return_delay": robot.bus.return_delay,
        "bus.latency": robot.bus.latency,
        "command_delay": robot.command_delay,
        "reading_age": robot.reading_age,
        "supply.resistance": robot.supply.resistance,
    }
    for key, value in at_least_0.items():
        if not value >= 0:
            raise RobotError(f"{place}: {key}: {value} is below 0")
    makers = {servo.type.maker for servo in robot.servos}
    if len(makers) > 1:
        raise RobotError(
            f"{place}: servos of {listed(sorted(makers))} on one bus; each has its own"
        )
    if makers == {"feetech"} and robot.watchdog:
        raise RobotError(f"{place}: watchdog: {robot.watchdog} s; Feetech servos have none: give 0")
    if not 0 <= robot.watchdog <= 2.54:
        raise RobotError(f"{place}: watchdog: {robot.watchdog} s; it can be 0 (off) to 2.54 s")


def _check_servo(robot: Robot, servo: Servo, place: str) -> None:
    kind = servo.type
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
    if not servo.velocity > 0:
        raise RobotError(f"{place}: velocity {servo.velocity} rad/s is not above 0")
    if servo.torque is not None and not servo.torque > 0:
        raise RobotError(f"{place}: torque {servo.torque} N·m is not above 0; null means no limit")
    for name in robot.registers_of(servo):
        if not kind.register(name).writable:
            raise RobotError(f"{place}: registers: {name!r} can only be read")


def _model(name: Any, place: str) -> Path:
    if name is None:
        raise RobotError(
            f"{place}: this robot's MJCF is not part of the project; give robot.model=PATH "
            "(python -m hardware: model=PATH), with an actuator for each servo, of the same name"
        )
    for path in (Path(name), ASSETS / name):
        if path.is_file():
            return path
    known = sorted(file.name for file in ASSETS.glob("*.xml"))
    hint = did_you_mean(str(name), known)
    raise RobotError(f"{place}: there is no file {str(name)!r}{hint}; {ASSETS} has {listed(known)}")


def _mapping(value: Any, place: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise RobotError(f"{place}: {value!r} is not a table of names and values")
    return value


def _fields(cls: type, data: Any, place: str) -> dict[str, Any]:
    """Check names and plain types of a table against the fields of a dataclass."""
    data = _mapping(data, place)
    hints = typing.get_type_hints(cls)
    for key in data:
        if key not in hints:
            hint = did_you_mean(str(key), hints)
            raise RobotError(f"{place}: unknown key {key!r}{hint}; it can have {listed(hints)}")
    for item in fields(cls):
        needed = item.default is MISSING and item.default_factory is MISSING
        if needed and item.name not in data:
            raise RobotError(f"{place}: the key {item.name!r} is missing")
    return {key: _typed(value, hints[key], f"{place}: {key}") for key, value in data.items()}


def _typed(value: Any, wanted: Any, place: str) -> Any:
    """Return the value as the wanted plain type; raise RobotError if it cannot be that."""
    options = typing.get_args(wanted) if isinstance(wanted, types.UnionType) else (wanted,)
    if value is None and types.NoneType in options:
        return None
    if float in options and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if int in options and isinstance(value, int) and not isinstance(value, bool):
        return value
    if str in options and isinstance(value, str):
        return value
    if wanted == tuple[float, float]:
        if not isinstance(value, list | tuple) or len(value) != 2:
            raise RobotError(f"{place}: {value!r} is not a pair of numbers")
        low, high = (_typed(part, float, place) for part in value)
        return (low, high)
    if {int, float, str}.isdisjoint(options):
        return value
    names = " or ".join("null" if o is types.NoneType else o.__name__ for o in options)
    raise RobotError(f"{place}: {value!r} is not {names}")
