"""The bus's transfer times, from bytes, delays and the adapter's latency.

    cycle_time(robot, fast=True)        # s for commanding and reading every servo once
    sample_times(robot, fast=True)      # s after the request at which each servo measured, (n,)

A byte takes 10 bits. A servo answers after its return delay and a turn-round.
"""

from typing import NamedTuple

import numpy as np

from hardware.bus_client import SHIELD, TURN_ROUND
from hardware.config import Robot

BLOCK, BLOCK_SIZE = 120, 16  # realtime tick to present position


class Framing(NamedTuple):
    """Bytes of a maker's packets for n servos: fixed ones, and those of each servo."""

    command: tuple[int, int]
    request: tuple[int, int]
    answer: int  # a plain answer to the driver's read
    part: int | None  # a servo's part of a fast answer; None: there are none


FRAMINGS = {
    "dynamixel": Framing((19, 5), (14, 1), 11 + BLOCK_SIZE + SHIELD, 4 + BLOCK_SIZE + SHIELD),
    "feetech": Framing((8, 3), (8, 1), 6 + 15, None),
}


def framing(robot: Robot) -> Framing:
    """Return the framing of a robot's servos, which are all of one maker."""
    return FRAMINGS[robot.servos[0].type.maker]


def cycle_time(robot: Robot, fast: bool) -> float:
    """Return how long commanding and reading all servos takes on the wire [s]."""
    n, bus, frame = len(robot.servos), robot.bus, framing(robot)
    sent = frame.command[0] + frame.request[0] + n * (frame.command[1] + frame.request[1])
    fast = fast and frame.part is not None
    answer = 8 + n * (frame.part or 0) if fast else n * frame.answer
    waits = 1 if fast else n
    wire = (sent + answer) * 10 / bus.baud
    return wire + waits * (bus.return_delay + TURN_ROUND / 2) + bus.latency


def sample_times(robot: Robot, fast: bool) -> np.ndarray:
    """Return when each servo of a group read is sampled, after it was asked for [s], (n,)."""
    bus, n, frame = robot.bus, len(robot.servos), framing(robot)
    byte, order = 10 / bus.baud, np.arange(n)
    wait = bus.return_delay + TURN_ROUND / 2
    first = (frame.request[0] + n * frame.request[1]) * byte
    if fast and frame.part is not None:
        return first + wait + order * frame.part * byte
    return first + (order + 1) * wait + order * frame.answer * byte
