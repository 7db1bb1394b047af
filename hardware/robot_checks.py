"""Whether a robot's file can be: its servos, their limits, their supplies and their buses.

check_robot(robot, "bench1.yaml")       # RobotError: the value, its place, what is allowed
"""

import math
import re

from hardware.errors import RobotError, format_names
from hardware.parts import Bus, Servo
from hardware.readings import VOLTAGE_ERROR
from hardware.robot import WATCHDOG_STEP, Robot
from hardware.tables import ServoType

BY_SETUP = "python -m hardware setup writes it"
OWNED = {  # what `registers` may not hold, as regular expressions, and what sets it instead
    "id": f"the servo's key id ({BY_SETUP})",
    "baud_rate": f"bus.baud ({BY_SETUP})",
    "return_delay_time": f"bus.return_delay ({BY_SETUP})",
    "drive_mode|phase": "the servo's sign, or the calibration",
    "homing_offset|angular_resolution": "the servo's zero, or the calibration",
    "bus_watchdog": "the key watchdog",
    "goal_pwm": "the servo's torque",
    "torque_enable|goal_position|goal_velocity": "the program itself, once the robot is armed",
    "secondary_id|protocol_type|status_return_level|startup_configuration|lock|indirect_.*": (
        "the program itself"
    ),
}
IN_RAD = "angles are in rad"
LONGEST_WATCHDOG = 127  # steps
MULTI_TURN = (4, 5)  # operating modes of Dynamixels whose goals are positions, in addition to 3


def check_robot(robot: Robot, place: str) -> None:
    """Refuse a robot whose servos, buses and limits do not go together.

    Args:
        robot: its keys have the right types.
        place: its file's name, for messages.

    Raises:
        RobotError: with the value, its place and what is allowed.
    """
    if not robot.servos:
        raise RobotError(f"{place}: servos: a robot has at least one")
    if not robot.rate > 0:
        raise RobotError(f"{place}: rate: {robot.rate} is not above 0")
    for servo in robot.servos:
        _check_servo(robot, servo, f"{place}: servos.{servo.name}")
    for part in robot.parts():
        _check_bus(part, place)
    widest = max(high - low for low, high in (servo.position for servo in robot.servos))
    if not 0 < robot.max_step <= widest:
        raise RobotError(
            f"{place}: max_step: {robot.max_step:g}; it is above 0, at most {widest:g}, the "
            f"largest travel of a joint; {IN_RAD}"
        )
    at_least_0 = {"command_delay": robot.command_delay, "reading_age": robot.reading_age}
    for key, value in at_least_0.items():
        if not value >= 0:
            raise RobotError(f"{place}: {key}: {value} is below 0")
    if {servo.type.maker for servo in robot.servos} == {"feetech"} and robot.watchdog:
        raise RobotError(f"{place}: watchdog: {robot.watchdog} s; Feetech servos have none: give 0")
    least, most = WATCHDOG_STEP, WATCHDOG_STEP * LONGEST_WATCHDOG
    if robot.watchdog and not least <= robot.watchdog <= most:
        raise RobotError(
            f"{place}: watchdog: {robot.watchdog} s; expected 0 (off), or {least:g} to {most:g} s"
        )


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
                f"{place}: servos.{servo.name}: id {servo.id} is not unique on its bus"
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
        raise RobotError(f"{place}: id {servo.id}; expected 0 to 251")
    if servo.sign not in (1, -1):
        raise RobotError(f"{place}: sign {servo.sign}; expected 1 or -1")
    if not abs(servo.zero) <= 2 * kind.units.counts_per_turn:
        raise RobotError(
            f"{place}: zero {servo.zero:g}; a turn of its encoder has {kind.units.counts_per_turn} "
            "counts, and the zero is within two turns"
        )
    _check_range(robot, servo, place)
    if servo.torque is not None and not servo.torque > 0:
        raise RobotError(f"{place}: torque {servo.torque} N·m is not above 0; null means no limit")
    _check_effort(servo, place)
    check_registers(robot, servo, place)
    _check_supply(robot, servo, place)
    fastest = (servo.position[1] - servo.position[0]) * robot.rate
    if not 0 < servo.velocity <= fastest:
        raise RobotError(
            f"{place}: velocity {servo.velocity:g} rad/s; it is above 0, at most {fastest:g}, its "
            f"whole travel in one step; {IN_RAD}"
        )


def check_registers(robot: Robot, servo: Servo, place: str) -> None:
    """Check what is written at each start: nothing that powers, renames or turns round a servo."""
    kind = servo.type
    for name, value in {**robot.registers, **servo.registers}.items():
        register = kind.register(name)
        owner = next((owner for names, owner in OWNED.items() if re.fullmatch(names, name)), None)
        if owner is not None:
            raise RobotError(
                f"{place}: registers: {name} = {value}; it is set by {owner}: leave it out"
            )
        if not register.writable:
            raise RobotError(f"{place}: registers: {name!r} can only be read")
        low, high = register.fixed_range
        if not isinstance(value, int) or not low <= value <= high:
            raise RobotError(f"{place}: registers: {name} = {value}; expected {low} to {high}")
    mode, modes = robot.mode_of(servo), position_modes(kind)
    if mode not in modes:
        raise RobotError(
            f"{place}: registers: operating_mode = {mode}; goals are positions: a {servo.model} "
            f"takes them in {format_names(map(str, modes))}"
        )


def position_modes(kind: ServoType) -> list[int]:
    """Return the operating modes in which a type's goals are positions."""
    return [kind.position_mode, *(mode for mode in MULTI_TURN if mode in kind.modes)]


def _check_supply(robot: Robot, servo: Servo, place: str) -> None:
    """Check that a servo takes the voltage of its supply, unless its file masks that error."""
    given, unit = robot.registers_of(servo), servo.type.units.voltage
    registers, volts = {**servo.type.defaults, **given}, robot.supply_of(servo).voltage
    known = {"min_voltage_limit", "max_voltage_limit"} <= registers.keys()
    if not known or not given.get("shutdown", VOLTAGE_ERROR) & VOLTAGE_ERROR:
        return
    low, high = registers["min_voltage_limit"] * unit, registers["max_voltage_limit"] * unit
    if not low <= volts <= high:
        raise RobotError(
            f"{place}: its supply has {volts:g} V, and a {servo.model} takes {low:g} to {high:g} V "
            f"(its voltage limits); correct the supply, or give this servo its own, as in "
            f"supply: {{voltage: {servo.type.voltage:g}}}"
        )


def _check_range(robot: Robot, servo: Servo, place: str) -> None:
    """Check that the servo takes goals at the angles that are commanded."""
    low, high = servo.position
    if not low < high:
        raise RobotError(f"{place}: position [{low}, {high}]: the first must be below the second")
    beyond = beyond_goals(robot, servo)
    if beyond is not None:
        raise RobotError(
            f"{place}: position [{low:g}, {high:g}] {beyond}: narrow it or correct the zero; "
            f"{IN_RAD}"
        )


def beyond_goals(robot: Robot, servo: Servo) -> str | None:
    """Say which counts a servo's angles have, if it does not take goals at all of them."""
    kind = servo.type
    first, end = sorted(servo.count(angle) for angle in servo.position)
    if robot.mode_of(servo) != kind.position_mode:  # it counts whole turns
        least, most = kind.register("goal_position").fixed_range
    else:
        least, most = 0, kind.units.counts_per_turn - 1
    shift = first if kind.maker == "feetech" else 0  # what its own homing offset can take off
    if least <= first - shift <= end - shift <= most:
        return None
    return (
        f"is {first} to {end} counts (zero {servo.zero:g}), and a {servo.model} takes {least} to "
        f"{most}"
    )


def _check_effort(servo: Servo, place: str) -> None:
    """Check the limit of current or of load, whichever the servo reports."""
    reports = "load" if servo.type.current is None else "current"
    other = "current" if reports == "load" else "load"
    if getattr(servo, other) is not None:
        raise RobotError(f"{place}: {other}: a {servo.model} reports its {reports}; give {reports}")
    value = getattr(servo, reports)
    most = 1.0 if servo.type.current is None else _largest_current(servo)
    if value is not None and not 0 < value <= most:
        unit = "" if reports == "load" else " A"
        raise RobotError(f"{place}: {reports} {value}; it is above 0, at most {most:g}{unit}")


def _largest_current(servo: Servo) -> float:
    """Return the largest limit of current that a servo's register takes [A]."""
    kind = servo.type
    register = kind.registers.get("current_limit")
    return math.inf if register is None else register.fixed_range[1] * (kind.current or 0.0)
