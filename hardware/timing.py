"""How long the bus takes, from bytes, delays and the adapter's latency.

    cycle_time(robot, fast=True)        # s for commanding and reading every servo once
    sample_times(robot, fast=True)      # s after the request at which each servo measured, (n,)

A byte takes 10 bits. A servo answers after its return delay and a turn-round.
"""

from __future__ import annotations

import numpy as np

from hardware.bus_client import SHIELD, TURN_ROUND
from hardware.config import Robot

BLOCK, BLOCK_SIZE = 120, 16  # realtime tick to present position
ANSWER = BLOCK_SIZE + SHIELD  # bytes of a servo's data
PLAIN, FAST = 11, 4  # bytes around them in a plain answer, and in a part of a fast one


def cycle_time(robot: Robot, fast: bool) -> float:
    """Return how long commanding and reading all servos takes on the wire [s]."""
    n, bus = len(robot.servos), robot.bus
    command, request = 19 + 5 * n, 14 + n
    answer = 8 + n * (ANSWER + FAST) if fast else n * (ANSWER + PLAIN)
    waits = 1 if fast else n
    wire = (command + request + answer) * 10 / bus.baud
    return wire + waits * (bus.return_delay + TURN_ROUND / 2) + bus.latency


def sample_times(robot: Robot, fast: bool) -> np.ndarray:
    """Return when each servo of a group read is sampled, after it was asked for [s], (n,)."""
    bus, n = robot.bus, len(robot.servos)
    byte, order = 10 / bus.baud, np.arange(n)
    wait = bus.return_delay + TURN_ROUND / 2
    first = (14 + n) * byte
    if fast:
        return first + wait + order * (ANSWER + FAST) * byte
    return first + (order + 1) * wait + order * (ANSWER + PLAIN) * byte
