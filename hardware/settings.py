"""Registers that a robot's file requires of its servos, and their differences.

    for difference in differences(client, robot, servo):
        print(difference)                       # servo 2 (elbow): return_delay_time 250 -> 0: ...

`unsafe_settings` are those under which a servo would move by itself, or answer too late: no robot
with them is connected. `differences` are all that `python -m hardware setup` writes.
"""

from typing import NamedTuple

from hardware.bus_client import BusClient
from hardware.config import Robot, Servo
from hardware.registers import read_register

MOVES_BY_ITSELF, REVERSED_OR_TIMED = 8, 5
NO_SECOND_ID = 255
LAST_ID = 252


class Difference(NamedTuple):
    """One register that is not as a robot needs it."""

    servo: Servo
    register: str
    found: int
    wanted: int
    why: str

    @property
    def sentence(self) -> str:
        """The difference in words, with its remedy."""
        place = f"servo {self.servo.id} ({self.servo.name})"
        return f"{place}: {self.why}; write {self.register} = {self.wanted}"

    def __str__(self) -> str:
        place = f"servo {self.servo.id} ({self.servo.name})"
        return f"{place}: {self.register} {self.found} -> {self.wanted}: {self.why}"


def unsafe_settings(client: BusClient, robot: Robot, servo: Servo) -> list[Difference]:
    """Return the settings under which a servo would move by itself, or answer too late."""
    found = []

    def differs(register: str, value: int, wanted: int, why: str) -> None:
        found.append(Difference(servo, register, value, wanted, why))

    if servo.type.maker == "feetech":
        return _feetech_dangers(client, servo) + _slow(client, robot, servo)
    mode = read_register(client, servo, "drive_mode")
    if mode & MOVES_BY_ITSELF:
        differs("drive_mode", mode, 0, f"drive mode {mode}: a goal would switch its torque on")
    elif mode & REVERSED_OR_TIMED:
        why = (
            f"drive mode {mode} reverses it or times its profile; the robot's sign says directions"
        )
        differs("drive_mode", mode, 0, why)
    offset = read_register(client, servo, "homing_offset")
    if offset:
        why = f"its own homing offset is {offset}; the calibration says the zero"
        differs("homing_offset", offset, 0, why)
    return found + _slow(client, robot, servo)


def _feetech_dangers(client: BusClient, servo: Servo) -> list[Difference]:
    mode = read_register(client, servo, "operating_mode")
    if mode == servo.type.position_mode:
        return []
    why = f"operating mode {mode}: its goals are not positions"
    return [Difference(servo, "operating_mode", mode, servo.type.position_mode, why)]


def _slow(client: BusClient, robot: Robot, servo: Servo) -> list[Difference]:
    unit = servo.type.units.return_delay
    delay = read_register(client, servo, "return_delay_time")
    allowed = round(robot.bus.return_delay / unit)
    if delay <= allowed:
        return []
    why = f"answers after {delay * unit * 1e6:.0f} us (or set bus.return_delay)"
    return [Difference(servo, "return_delay_time", delay, allowed, why)]


def differences(client: BusClient, robot: Robot, servo: Servo) -> list[Difference]:
    """Return all settings that are not as the robot's file wants them; RAM is left out."""
    found = unsafe_settings(client, robot, servo)
    named = {difference.register for difference in found}
    for register, (wanted, why) in _wanted(robot, servo).items():
        if register in servo.type.registers and register not in named:
            value = read_register(client, servo, register)
            if value != wanted and not (register == "secondary_id" and value > LAST_ID):
                found.append(Difference(servo, register, value, wanted, why))
    return found + _narrow_limits(client, robot, servo)


def _wanted(robot: Robot, servo: Servo) -> dict[str, tuple[int, str]]:
    """Return {register: (value, why)} of the settings that must be exactly so."""
    wanted = {
        "protocol_type": (2, "this program speaks protocol 2"),
        "secondary_id": (NO_SECOND_ID, "it would obey another servo's goals"),
        "operating_mode": (robot.mode_of(servo), "goals are positions"),
    }
    for name, value in robot.registers_of(servo).items():
        if servo.type.register(name).eeprom:
            wanted[name] = (value, "the robot's file says so")
    return wanted


def _narrow_limits(client: BusClient, robot: Robot, servo: Servo) -> list[Difference]:
    """Return the servo's own limits if they are narrower than the robot's file."""
    if robot.mode_of(servo) != servo.type.position_mode:
        return []  # other modes have no such limits
    offset = 0
    if servo.type.maker == "feetech":  # its limits are of what it reports
        offset = read_register(client, servo, "homing_offset")
    low, high = sorted(servo.count(angle) - offset for angle in servo.position)
    found = []
    for register, end, outside in (
        ("min_position_limit", 0, lambda limit: limit > low),
        ("max_position_limit", servo.type.units.counts_per_turn - 1, lambda limit: limit < high),
    ):
        limit = read_register(client, servo, register)
        if limit != end and outside(limit):
            why = f"the robot's file commands {low} to {high}"
            found.append(Difference(servo, register, limit, end, why))
    return found
