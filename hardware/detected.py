"""A robot made of the servos that a scan finds, for who has no file of it yet.

    robot = detect("/dev/ttyUSB0")
    [servo.name for servo in robot.servos]          # ["servo1", "servo2"]

Its servos have their counts' own zero and direction, and no limits: it is for looking and setting
up, never for moving.
"""

import math
from collections.abc import Iterable, Iterator, Sequence

from dynamixel_sdk import PortHandler

from hardware.bus_client import BusClient
from hardware.clock import RealClock
from hardware.config import NO_MODEL, Robot
from hardware.connect import DRIVERS
from hardware.errors import ServoError, format_names
from hardware.handshake import several
from hardware.parts import BusSettings, Servo, Supply
from hardware.scan import DetectedServo, scan
from hardware.serial_ports import latency_timer
from hardware.tables import servo_types

LATENCY = 0.001  # s that an adapter holds bytes back which has no timer for it
RETURN_DELAY = 0.0005  # s, the factory's


def client_of(port: str, maker: str) -> BusClient:
    """Return a client of one maker's servos at a port; it is not open yet."""
    latency = latency_timer(port)
    kind = DRIVERS[maker].client_type
    return kind(PortHandler(port), RealClock(), LATENCY if latency is None else latency)


def scan_port(port: str, makers: Iterable[str] = tuple(DRIVERS)) -> Iterator[DetectedServo]:
    """Yield every servo of these makers that answers at a port, speed by speed.

    Raises:
        SerialPortError: the port cannot be used.
    """
    for maker in makers:
        client = client_of(port, maker)
        try:
            yield from scan(client, maker)
        finally:
            client.close()


def detect(port: str) -> Robot:
    """Return the robot of all servos at a port.

    Raises:
        SerialPortError: the port cannot be used.
        ServoError: no servo answers, or they cannot be one robot: several speeds or makers, or a
            type that is not known.
    """
    return robot_of(list(scan_port(port)), port)


def robot_of(found: Sequence[DetectedServo], port: str | None) -> Robot:
    """Return the robot of servos that were found at a port; raises ServoError as `detect`."""
    if not found:
        raise ServoError(f"{port}: no servo answers at any speed; check supply, cable and adapter")
    if len({(servo.baud, servo.maker) for servo in found}) > 1:
        raise ServoError(
            f"{port}: the servos differ in speed or manufacturer: "
            f"{format_names(map(str, found))}; give robot="
        )
    for servo in found:
        if servo.shared:
            raise ServoError(f"{port}: {several(servo.id)}")
        if servo.model not in servo_types():
            raise ServoError(f"{port}: servo {servo.id} is {servo.model}, which is not supported")
    servos = tuple(detected_servo(f"servo{each.id}", each) for each in found)
    latency = None if port is None else latency_timer(port)
    return Robot(
        name=f"the robot at {port}",
        model=NO_MODEL,
        servos=servos,
        registers={},
        bus=BusSettings(found[0].baud, RETURN_DELAY, LATENCY if latency is None else latency),
        rate=1.0,
        command_delay=0.0,
        reading_age=0.0,
        max_step=0.1,
        watchdog=0.0,
        supply=Supply(servos[0].type.voltage),
        port=port,
    )


def detected_servo(name: str, found: DetectedServo) -> Servo:
    """Return a servo that was found, its angle measured from its count 0."""
    turn = (0.0, 2 * math.pi)
    return Servo(name, found.id, found.model, 1, 0.0, turn, 1.0, None)
