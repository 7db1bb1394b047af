"""Torque off wherever a servo can be reached: the verb torque.

    switch_off(driver, tell)                    # a robot's servos, bus by bus
    switch_off_at(["/dev/ttyUSB0"], tell)       # whatever is there, at every speed

Nothing that fails on one bus or in one servo keeps another from being switched off. Which servos
have confirmed is told, also after Ctrl-C; which have not is the error.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress

from hardware.bus_client import BusClient
from hardware.connect import DRIVERS
from hardware.detected import client_of, detected_servo
from hardware.driver import Driver
from hardware.errors import HardwareError, SerialPortError, ServoError, format_names
from hardware.handshake import several
from hardware.registers import write_register
from hardware.scan import ALL_SPEEDS, DetectedServo, scan
from hardware.tables import servo_types
from hardware.terminal import Tell

SENDING = 0.05  # s in which torque-off has left an adapter at 9600 bits/s
CUT = "cut the supply"


def switch_off(driver: Driver, tell: Tell) -> None:
    """Switch a robot's torque off on each bus by itself, and let each servo confirm it.

    Raises:
        ServoError: a port cannot be used, or a servo did not confirm; with the servos that may
            still be powered.
    """
    for servo in driver.robot.servos:
        driver.mark_powered(servo)
    try:
        failed = _off_on_each_bus(driver)
    except KeyboardInterrupt:
        tell(f"interrupted; {_doubt(driver)}")
        raise
    if off := [name for name in driver.robot.names if name not in driver.powered]:
        tell(f"{driver.robot.name}: torque is off in {format_names(off)}")
    if driver.powered:
        raise ServoError("; ".join([*failed, _doubt(driver)]))


def _off_on_each_bus(driver: Driver) -> list[str]:
    """Switch torque off bus by bus; return what is wrong with ports."""
    failed = []
    for part in driver.parts:
        try:
            part.bus_client.open(part.robot.bus.baud)
            part.torque_off()
        except SerialPortError as error:
            failed.append(str(error))
        except ServoError:
            pass  # its servos that did not confirm remain marked as powered
    return failed


def _doubt(driver: Driver) -> str:
    on = [name for name in driver.robot.names if name in driver.powered]
    return f"torque may still be on in {format_names(on)}: {CUT}"


def switch_off_at(ports: Sequence[str], tell: Tell) -> None:
    """Broadcast torque-off at every speed of every port, then let each servo found confirm it.

    Raises:
        ServoError: a port cannot be used, no servo answers at one, or one did not confirm.
    """
    doubts = []
    try:
        for port in ports:
            _broadcast(port)
        for port in ports:
            found = False
            try:
                for client, servo in _servos(port):
                    found = True
                    doubts += _confirmed(client, servo, tell)
            except SerialPortError as error:
                doubts.append(str(error))
            else:
                if not found:
                    doubts.append(f"{port}: no servo answers at any speed; check supply and cable")
    except KeyboardInterrupt:
        tell(f"interrupted; all other servos may still have torque: {CUT}")
        raise
    if doubts:
        raise ServoError(f"torque may still be on: {'; '.join(doubts)}: {CUT}")


def _clients(port: str) -> Iterator[tuple[str, BusClient]]:
    for maker in DRIVERS:
        client = client_of(port, maker)
        try:
            yield maker, client
        finally:
            client.close()


def _broadcast(port: str) -> None:
    """Send torque-off in each protocol at each speed that the port can run at."""
    for maker, client in _clients(port):
        for baud in ALL_SPEEDS[maker]:
            with suppress(SerialPortError):  # the search for servos says it
                client.open(baud)
                for _ in range(2):
                    client.write_all(DRIVERS[maker].torque, b"\x00")
                client.clock.sleep_until(client.clock.now() + SENDING)


def _servos(port: str) -> Iterator[tuple[BusClient, DetectedServo]]:
    for maker, client in _clients(port):
        with client.more_patient():
            for found in scan(client, maker):
                yield client, found


def _confirmed(client: BusClient, found: DetectedServo, tell: Tell) -> list[str]:
    """Switch one servo off and tell so; return why it may still be powered, if it may."""
    name = f"ID {found.id} at {found.baud} bits/s"
    if found.model not in servo_types():
        return [f"{name} ({found.model} is not supported)"]
    if found.shared:
        return [f"{name} ({several(found.id)})"]
    try:
        write_register(client, detected_servo(name, found), "torque_enable", 0)
    except HardwareError as error:
        return [str(error)]
    tell(f"torque is off in {found}")
    return []
