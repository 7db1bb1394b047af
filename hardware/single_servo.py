"""Look at, set, restart and hold servos: the verbs read, write, reboot, and torque with on=true.

    read(driver, "elbow", "present_position", print)
    write(driver, "elbow", "position_p_gain", 800, may_move=False, tell=print)

Servos are named as in the robot's file, or by ID. No write moves a servo unless that was allowed:
one that has torque is written to only then.
"""

from dataclasses import replace

from hardware.command_line import UsageError
from hardware.config import Servo
from hardware.connect import patient
from hardware.driver import Driver
from hardware.errors import ServoError, did_you_mean, format_names
from hardware.pace import FixedRate
from hardware.registers import read_register, write_register
from hardware.safety import Guard
from hardware.scan import DetectedServo
from hardware.settings import Difference
from hardware.setup import write_settings
from hardware.terminal import Ask, Tell

BOOT = 1.0  # s that a servo may take to answer again


def open_ports(driver: Driver) -> None:
    """Open every port at its speed, without a look at the servos."""
    for part in driver.parts:
        part.bus_client.open(part.robot.bus.baud)


def chosen(driver: Driver, name: str | None) -> list[tuple[Driver, Servo]]:
    """Return the servos that a name or an ID means, each with the driver of its bus.

    Args:
        driver: of the robot.
        name: the actuator, or the ID; None for all.

    Raises:
        UsageError: there is no such servo, or several have this ID.
    """
    servos = [(part, servo) for part in driver.parts for servo in part.robot.servos]
    if name is None:
        return servos
    found = [(part, one) for part, one in servos if name in (one.name, str(one.id))]
    if len(found) != 1:
        known = [f"{one.name} (ID {one.id})" for _, one in servos]
        hint = did_you_mean(name, [one.name for _, one in servos])
        what = "several servos have that ID" if found else f"no such servo{hint}"
        raise UsageError(f"servo={name}: {what}; available: {format_names(known)}")
    return found


def read(driver: Driver, servo: str | None, register: str | None, tell: Tell) -> None:
    """Show registers: one or all, of one servo or of all.

    Raises:
        UsageError, RobotError: no such servo, or no such register.
        ServoError: a servo does not answer.
    """
    servos = chosen(driver, servo)
    for _, each in servos:
        if register is not None:
            each.type.register(register)
    open_ports(driver)
    with patient(driver):
        for part, each in servos:
            names = [n for n in each.type.registers if not n.startswith("indirect_")]
            tell(f"{each.name} (ID {each.id}, {each.model})")
            for name in names if register is None else [register]:
                tell(f"  {name} = {read_register(part.bus_client, each, name)}")


def write(
    driver: Driver, servo: str, register: str, value: int, may_move: bool, tell: Tell
) -> None:
    """Write one register of one servo and read it back; EEPROM after its torque is off.

    Args:
        driver: of the robot.
        servo: its name or ID.
        register: its name in the manual.
        value: the raw value.
        may_move: whether a servo that has torque may be written to.
        tell: shows a line.

    Raises:
        UsageError: a servo, register or value that cannot be.
        ServoError: the servo has torque, does not answer, or does not take the value.
    """
    [(part, one)] = chosen(driver, servo)
    place = one.type.register(register)
    low, high = place.fixed_range
    whole = place.encode(value)
    if not low <= value <= high or place.decode(whole) != value:
        raise UsageError(f"{register} = {value}; expected {low:g} to {high:g}, {place.size} bytes")
    if not place.writable:
        raise UsageError(f"{register} can only be read")
    if register == "torque_enable":
        raise UsageError("use python -m hardware torque to switch torque")
    open_ports(driver)
    client = part.bus_client
    with patient(driver):
        if read_register(client, one, "torque_enable") and not may_move:
            raise ServoError(
                f"{one.name} has torque and may move: switch torque off (python -m hardware "
                f"torque), "
                "or add arm=true"
            )
        before = read_register(client, one, register)
        if place.eeprom:
            _write_eeprom(part, one, Difference(one, register, before, value, "as asked"))
        else:
            write_register(client, one, register, value)
    tell(f"{one.name}: {register} {before} -> {value}")


def _write_eeprom(part: Driver, servo: Servo, change: Difference) -> None:
    """Write what outlasts the supply: a new ID or speed is answered from there on."""
    baud, kind = part.robot.bus.baud, servo.type
    found = DetectedServo(baud, servo.id, kind.number, kind.firmware, kind.maker)
    new = replace(servo, id=change.wanted) if change.register == "id" else servo
    if change.register == "id" and part.bus_client.ping(new.id):
        raise ServoError(f"a servo already has the ID {new.id}; choose another")
    if change.register == "baud_rate":
        baud = kind.bauds[change.wanted]
    write_settings(part.bus_client, new, found, [change], baud)


def reboot(driver: Driver, servo: str | None, tell: Tell) -> None:
    """Reboot one servo or all: torque off, errors cleared, RAM as from the factory.

    Raises:
        ServoError: a servo does not answer again.
        SerialPortError: servos that cannot be rebooted over their bus.
    """
    servos = chosen(driver, servo)
    open_ports(driver)
    for part, each in servos:
        part.bus_client.reboot(each.id)
        end = driver.clock.now() + BOOT
        while not part.bus_client.ping(each.id):
            if driver.clock.now() > end:
                raise ServoError(f"{each.name} (ID {each.id}) does not answer after its reboot")
        tell(f"{each.name} (ID {each.id}) has rebooted, its torque is off")


def hold(driver: Driver, ask: Ask, tell: Tell) -> None:
    """Hold the robot where it is, watched by the guard, until Enter; then torque is off.

    Raises:
        SafetyError: the robot was stopped.
        HardwareError: see `Guard.arm`.
    """
    driver.connect()
    driver.configure()
    pace = FixedRate(driver.clock, driver.robot.rate)
    with Guard(driver) as guard:
        here = guard.arm().position

        def step() -> None:
            pace.wait()
            guard.read()
            guard.command(here)

        ask(f"{driver.robot.name} holds; press Enter to switch its torque off ", step)
    tell(f"{driver.robot.name}: torque is off")
