"""A driver's checks before torque is switched on; each refusal is a sentence with its remedy."""

import struct
from pathlib import Path

from hardware.bus_client import BusClient, Reply
from hardware.config import Robot, Servo
from hardware.errors import SerialPortError, ServoError, format_names
from hardware.registers import RETRIES
from hardware.serial_ports import latency_timer
from hardware.settings import unsafe_settings
from hardware.tables import servo_by_number
from hardware.timing import cycle_time

SPEEDS = (57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000)
SPEEDS_OF = {"dynamixel": SPEEDS, "feetech": (1_000_000, 500_000, 115200, 57600, 38400, 19200)}
SLOWEST = 0.5  # s, the longest that an answer is waited for
BY_SETUP = "(python -m hardware setup does)"


def check_rate(robot: Robot) -> None:
    """Refuse a rate that the bus cannot reach, with the one that it can.

    Raises:
        ServoError: commanding and reading all servos takes longer than a step.
    """
    span = cycle_time(robot, fast=True)
    if span > 1 / robot.rate:
        bus = robot.bus
        raise ServoError(
            f"{robot.name}: {len(robot.servos)} servos at {bus.baud} bits/s, return delay "
            f"{bus.return_delay * 1e6:.0f} us and latency {bus.latency * 1e3:.0f} ms take "
            f"{span * 1e3:.1f} ms a step: at most {1 / span:.0f} steps per second, not "
            f"{robot.rate:g}; raise bus.baud, or lower bus.return_delay and bus.latency"
        )


def check_latency_timer(robot: Robot, client: BusClient) -> None:
    """Refuse an adapter whose latency timer is longer than the robot's file says.

    Raises:
        ServoError: with the command that sets it.
    """
    latency, allowed = latency_timer(client.port.port_name), robot.bus.latency
    if latency is not None and latency > allowed:
        name = Path(client.port.port_name).resolve().name  # by-id names are links
        raise ServoError(
            f"{name}: its latency timer is {latency * 1e3:.0f} ms, but the robot's file has "
            f"{allowed * 1e3:.0f}; run: setserial /dev/{name} low_latency"
        )


def check_servos(robot: Robot, client: BusClient) -> None:
    """Refuse servos that are missing, of another type, doubled, or set up dangerously.

    Raises:
        ServoError: with every servo that is not as it should be, and what to do.
    """
    missing, found = [], []
    for servo in robot.servos:
        replies = pinged(client, servo.id)
        if not replies:
            missing.append(servo)
        elif are_several(replies):
            found.append(
                f"several servos answer as {servo.id} ({servo.name}); connect them one by one "
                "and give each an ID of its own"
            )
        else:
            number = struct.unpack("<HB", replies[0][0].data)[0]
            found += _other_model(servo, number) or _dangers(robot, client, servo)
    if missing:
        found.append(_where_are(robot, client, missing))
    if len(found) == 1:
        raise ServoError(found[0])
    if found:
        lines = "".join(f"\n  {each}" for each in found)
        raise ServoError(f"{robot.name}: {len(found)} differences from its file:{lines}")


def pinged(client: BusClient, number: int) -> list[list[Reply]]:
    """Return the answers to several pings; what is odd is asked again with more patience.

    On a busy machine an answer may come after the next question, and look like another servo's.
    """
    replies = [client.ping(number) for _ in range(RETRIES)]
    if any(len(each) != 1 for each in replies):
        with client.more_patient():
            replies = [client.ping(number) for _ in range(RETRIES)]
    return [each for each in replies if each]


def _answers(client: BusClient, number: int) -> bool:
    """Say whether any servo answers, with the patience that a busy machine needs."""
    with client.more_patient():
        return any(client.ping(number) for _ in range(RETRIES))


def are_several(replies: list[list[Reply]]) -> bool:
    """Say whether more than one servo answered most pings; one answer alone may be a late one."""
    return 2 * sum(len(each) > 1 for each in replies) > len(replies)


def check_alone(client: BusClient, number: int) -> None:
    """Refuse to write for good under an ID that not exactly one servo has.

    Raises:
        ServoError: none or several answer.
    """
    replies = pinged(client, number)
    if not replies:
        raise ServoError(f"no servo answers as {number}; check cable and supply")
    if are_several(replies):
        raise ServoError(several(number))


def several(number: int) -> str:
    """Say that servos share an ID, and what to do."""
    return f"several servos answer as {number}; connect one only"


def _other_model(servo: Servo, number: int) -> list[str]:
    if number == servo.type.number:
        return []
    found = servo_by_number(number, servo.type.maker) or f"a model of number {number}"
    return [f"servo {servo.id} ({servo.name}) is {found}, but the robot's file has {servo.model}"]


def _dangers(robot: Robot, client: BusClient, servo: Servo) -> list[str]:
    with client.more_patient():
        return [f"{each.sentence} {BY_SETUP}" for each in unsafe_settings(client, robot, servo)]


def _lateness(client: BusClient, servo: Servo) -> float | None:
    """Return how late a servo answers that did not in time [s], or None if it does not at all."""
    register = servo.type.register("id")
    with client.more_patient(SLOWEST / client.patience):
        reply = client.read(servo.id, register.address, register.size)
    return None if reply is None else client.lateness


def _where_are(robot: Robot, client: BusClient, missing: list[Servo]) -> str:
    """Look for missing servos behind a slow link and at other speeds, and say what was found."""
    late = _lateness(client, missing[0])
    if late is not None:
        return (
            f"{missing[0].name} answers {1e3 * late:.0f} ms later than the wire explains: the link "
            "is slow; look at the adapter, the hub, and other programs"
        )
    names = format_names(f"{servo.id} ({servo.name})" for servo in missing)
    baud, found = robot.bus.baud, []
    for speed in SPEEDS_OF[robot.servos[0].type.maker]:
        if speed == baud:
            continue
        try:
            client.open(speed)
            there = [str(servo.id) for servo in missing if _answers(client, servo.id)]
        except SerialPortError:
            continue
        if there:
            found.append(f"{', '.join(there)} at {speed} bits/s: set its baud_rate {BY_SETUP}")
    client.open(baud)
    remedy = "; ".join(found) or "check cable, supply and ID (python -m hardware scan)"
    return (
        f"no answer at {baud} bits/s from {names}; found: {remedy}"
        if found
        else (f"no answer at any speed from {names}: {remedy}")
    )
