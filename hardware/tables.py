"""Servo types: registers by name, units, factory values and motor constants.

    servo = servo_type("xl330-m288")
    servo.registers["goal_position"]        # Register(name='goal_position', address=116, size=4)
    servo.position_gain(800, volts=5.0)     # N·m/rad of the position loop

Control tables are read from the model files that dynamixel-sdk ships; `hardware/servos.yaml` adds
what they leave out, and `hardware/servos_by_sheet.yaml` names further types by their data sheets:
those can be found, set up, read and commanded, and some of them emulated. Register names are the
manual's, in lower case with underscores.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import yaml

from hardware.errors import RobotError, did_you_mean, format_names

FIRST_RAM = 64
FASTEST_SLOPE = 255  # of the PWM slope register: taken as no limit
FEETECH = ("sts3215",)
SIGNED = (
    *("homing_offset", "goal_pwm", "goal_current", "goal_velocity", "goal_position", "present_pwm"),
    *("present_current", "present_load", "present_velocity", "present_position"),
    *("velocity_trajectory", "position_trajectory", "min_position_limit", "max_position_limit"),
    "bus_watchdog",
)


@dataclass(frozen=True)
class Register:
    """One line of a control table."""

    name: str
    address: int
    size: int  # bytes: 1, 2 or 4
    signed: bool
    writable: bool
    low: int | str | None  # least value; a name stands for that register's value
    high: int | str | None
    sign_bit: int | None = None  # of registers that hold a sign and a size; else two's complement
    first_ram: int = FIRST_RAM

    @property
    def eeprom(self) -> bool:
        """Whether it survives a reboot, and can only be written while torque is off."""
        return self.address < self.first_ram

    @property
    def fixed_range(self) -> tuple[float, float]:
        """Least and largest value that no other register sets; infinite where none is known."""
        low = self.low if isinstance(self.low, int) else -math.inf
        high = self.high if isinstance(self.high, int) else math.inf
        return low, high

    def encode(self, value: int) -> bytes:
        """Return the value's bytes, least first."""
        if self.sign_bit is not None:
            value = abs(value) | (value < 0) << self.sign_bit
        return (value % (1 << 8 * self.size)).to_bytes(self.size, "little")

    def decode(self, data: bytes | bytearray) -> int:
        """Return the number that the bytes stand for."""
        if self.sign_bit is None:
            return int.from_bytes(data[: self.size], "little", signed=self.signed)
        value = int.from_bytes(data[: self.size], "little")
        size = value & (1 << self.sign_bit) - 1
        return -size if value >> self.sign_bit & 1 else size


@dataclass(frozen=True)
class Units:
    """Units of a servo type's registers, and their steps."""

    counts_per_turn: int
    velocity: float  # rad/s
    acceleration: float  # rad/s^2
    full_pwm: int
    voltage: float  # V
    return_delay: float  # s
    watchdog: float = 0.0  # s
    position_d: int = 1
    position_i: int = 1
    velocity_p: int = 1
    velocity_i: int = 1
    feedforward: int = 1

    @property
    def angle(self) -> float:
        """Radians of one count of the encoder."""
        return 2 * math.pi / self.counts_per_turn


@dataclass(frozen=True)
class ServoType:
    """A type of servo; `hardware/servos.yaml` says what each number is and where it is from."""

    name: str
    number: int
    firmware: int
    modes: tuple[int, ...]
    torque_constant: float  # N·m/A, and V·s/rad
    resistance: float  # ohm
    armature: float | None  # kg·m^2; None: not known, as are the factory's gains
    current: float | None  # A of one step
    gain_divisor: float
    voltage: float  # V
    heat: float | None  # K/W
    tau_thermal: float | None  # s
    indirect: int
    defaults: Mapping[str, int]
    registers: Mapping[str, Register]
    units: Units
    bauds: tuple[int, ...]
    maker: Literal["dynamixel", "feetech"] = "dynamixel"
    slope: float = 0.001977  # V/ms of one step of the PWM slope register

    @property
    def position_mode(self) -> int:
        """The operating mode in which goals are positions within one turn."""
        return 3 if self.maker == "dynamixel" else 0

    def check_emulated(self, place: str) -> None:
        """Refuse a type of which too little is known to emulate it.

        Args:
            place: which robot's which servo it is, for the message.

        Raises:
            RobotError: with the types that can be emulated.
        """
        if not self.emulated:
            known = [name for name in servo_types() if servo_type(name).emulated]
            raise RobotError(
                f"{place}: a {self.name} cannot be emulated; give port= for the real one, or use "
                f"{format_names(known)}"
            )

    def register(self, name: str) -> Register:
        """Return the register of this name.

        Raises:
            RobotError: the type has no such register.
        """
        if name not in self.registers:
            hint = did_you_mean(name, self.registers)
            raise RobotError(f"a {self.name} has no register {name!r}{hint}")
        return self.registers[name]

    @property
    def emulated(self) -> bool:
        """Whether enough is known to emulate it."""
        return self.armature is not None

    def position_gain(self, register: int, volts: float) -> float:
        """Stiffness of the position loop [N·m/rad] with this P gain register at this voltage.

        duty = counts of error * P / divisor / 885, torque = duty * V * K / R.
        """
        units = self.units
        duty = register / self.gain_divisor / units.full_pwm / units.angle
        return duty * self.stall_torque(volts)

    def stall_torque(self, volts: float) -> float:
        """Torque at standstill [N·m]: V K / R."""
        return volts * self.torque_constant / self.resistance

    def torque_rate(self, register: int) -> float:
        """Fastest change of torque [N·m/s] with this PWM slope register; inf if it limits none."""
        per_ms = register * self.slope * self.torque_constant / self.resistance
        return per_ms * 1000 if register < FASTEST_SLOPE else math.inf

    @property
    def back_emf_damping(self) -> float:
        """The damping by back-EMF with the winding driven [N·m·s/rad]: K^2 / R."""
        return self.torque_constant**2 / self.resistance


@cache
def _read(name: str) -> dict[str, Any]:
    return yaml.safe_load((Path(__file__).parent / name).read_text(encoding="utf-8"))


def _data() -> dict[str, Any]:
    return _read("servos.yaml")


@cache
def _models() -> dict[str, Any]:
    """Return the entry of each type: those of servos.yaml, then those by data sheet."""
    sections = ("types", "emulated", "limits")
    sheets, emulated, limits = (_read("servos_by_sheet.yaml")[key] for key in sections)
    found = {name: _by_sheet(**entry) | emulated.get(name, {}) for name, entry in sheets.items()}
    for name, page in limits.items():
        for register, values in page.items():
            if register != "page":
                _limit(found[name], register, values)
    return _data()["models"] | found


def _limit(entry: dict[str, Any], register: str, values: int | list[int]) -> None:
    """Put a register's factory value, and its range if it is known, into a type's entry."""
    *span, factory = [values] if isinstance(values, int) else values
    entry["defaults"][register] = factory
    if span:
        entry["ranges"][register] = span


def _by_sheet(
    number: int,
    table: str,
    firmware: int,
    current: float | None,
    voltage: float,
    stall: list[float],
    speed: float,
    hottest: int,
) -> dict[str, Any]:
    """Return a type's entry from its data sheet; stall [N·m, A], speed [turns/min]."""
    torque, amps = stall
    constant = math.sqrt(torque / amps * voltage / (speed * 2 * math.pi / 60))
    small = table.startswith("xc330")
    return {
        "number": number,
        "table": table,
        "firmware": firmware,
        "modes": [1, 3, 4, 16] if current is None else [0, 1, 3, 4, 5, 16],
        "torque_constant": constant,
        "resistance": voltage / amps,
        "armature": None,
        "current": current,
        "gain_divisor": 128,
        "voltage": voltage,
        "heat": None,
        "tau_thermal": None,
        "indirect": 20 if small else 56,
        "ranges": {"baud_rate": [0, 6]} if small else {},
        "defaults": {"temperature_limit": hottest},
    }


def servo_types() -> list[str]:
    """Return the names of the known types."""
    return [*_models(), *_feetech_models()]


@cache
def servo_type(name: str) -> ServoType:
    """Return the type of this name.

    Raises:
        RobotError: no such type is known, or dynamixel-sdk is not installed.
    """
    if name in _feetech_models():
        return _feetech_type(name)
    data, known = _data(), _models()
    if name not in known:
        hint = did_you_mean(name, servo_types())
        raise RobotError(f"unknown servo type {name!r}{hint}: {format_names(servo_types())}")
    entry = dict(known[name])
    table = _read_table(entry.pop("table"), entry["indirect"]) | _later(entry["firmware"])
    ranges = data["ranges"] | entry.pop("ranges", {})
    return ServoType(
        **entry
        | {
            "name": name,
            "modes": tuple(entry["modes"]),
            "defaults": data["defaults"] | entry["defaults"],
            "registers": {
                key: _register(key, *place, *ranges.get(key, (None, None)))
                for key, place in table.items()
            },
            "units": Units(**data["units"]),
            "bauds": tuple(data["bauds"]),
        }
    )


@cache
def _feetech_models() -> dict[str, dict[str, Any]]:
    """Return the entry of each type of Feetech's: what a file holds, and its variants."""
    found = {}
    for name in FEETECH:
        data = dict(_read(f"feetech/{name}.yaml"))
        variants = data.pop("variants")
        found[name] = data
        for variant, other in variants.items():
            defaults = data["defaults"] | other.get("defaults", {})
            found[variant] = data | other | {"defaults": defaults}
    return found


def _feetech_type(name: str) -> ServoType:
    """Return a type of Feetech's."""
    data = dict(_feetech_models()[name])
    first_ram, places = data.pop("first_ram"), data.pop("registers")
    fixed, ranges = data.pop("read_only"), data.pop("ranges")
    registers = {}
    for key, (address, size, *sign) in places.items():
        low, high = ranges.get(key, (None, None))
        bit = sign[0] if sign else None
        registers[key] = Register(
            key, address, size, bool(sign), key not in fixed, low, high, bit, first_ram
        )
    units, bauds = Units(**data.pop("units")), tuple(data.pop("bauds"))
    whole = {"name": name, "firmware": 0, "modes": (0,), "indirect": 0, "maker": "feetech"}
    return ServoType(**data | whole, registers=registers, units=units, bauds=bauds)


def servo_by_number(number: int, maker: str = "dynamixel") -> str | None:
    """Return the name of the type with this model number, if it is known; not all have tables."""
    if maker == "feetech":
        models = _feetech_models().items()
        return next((name for name, entry in models if entry["number"] == number), None)
    found = (name for name, entry in _models().items() if entry["number"] == number)
    return next(found, _read("servos_by_sheet.yaml")["names"].get(number))


def _later(firmware: int) -> dict[str, tuple[int, int]]:
    """Return {register: (address, size)} of what this firmware has beyond the SDK's table."""
    rows = _data()["later_registers"].items()
    return {name: (at, size) for name, (at, size, since) in rows if firmware >= since}


def _register(
    name: str, address: int, size: int, low: int | str | None, high: int | str | None
) -> Register:
    writable = name not in _data()["read_only"]
    return Register(name, address, size, name in SIGNED, writable, low, high)


@cache
def _read_table(stem: str, indirect: int) -> dict[str, tuple[int, int]]:
    """Return {register: (address, size)} from the SDK's model file."""
    spec = find_spec("dynamixel_easy_sdk")
    if spec is None or spec.origin is None:
        raise RobotError("control tables need dynamixel-sdk; pip install dynamixel-sdk")
    file = Path(spec.origin).parent / "control_table" / f"{stem}.model"
    lines = file.read_text(encoding="utf-8").split("[control table]")[1].splitlines()
    table = {}
    for line in lines[2:]:
        address, size, name = line.split("\t")
        if not name.startswith("Indirect"):
            table[_snake(name)] = (int(address), int(size))
        elif name.endswith(" 1"):
            first = int(address)
            table |= _indirect(_snake(name)[:-2], first, int(size), indirect)
    return table


def _indirect(stem: str, first: int, size: int, count: int) -> dict[str, tuple[int, int]]:
    """Entries 1 to 28 lie from `first` on; 29 to 56 lie from 578 (addresses), 634 (data) on."""
    late = 578 if size == 2 else 634
    starts = [first + size * i if i < 28 else late + size * (i - 28) for i in range(count)]
    return {f"{stem}_{i + 1}": (start, size) for i, start in enumerate(starts)}


def _snake(name: str) -> str:
    return re.sub(r"[^a-z0-9]+", "_", name.lower().replace("(shadow)", "")).strip("_")
