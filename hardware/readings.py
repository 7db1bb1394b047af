"""Readings of servos: their motion, all at once, and their state, one at a time."""

from typing import NamedTuple

import numpy as np


class Reading(NamedTuple):
    """The servos' measured motion, (n,) each, in the order of the robot's file."""

    time: float  # s, when the read was asked for
    position: np.ndarray  # rad
    velocity: np.ndarray  # rad/s
    current: np.ndarray  # A (0 for servos without such a sensor)
    effort: np.ndarray  # A, or of servos without such a sensor the load, a part of their full one
    duty: np.ndarray  # of full PWM, -1 to 1
    stamp: np.ndarray  # s, when each was measured, as the wire's timing has it
    count: np.ndarray  # int64, the raw position register
    fresh: np.ndarray  # bool: a new answer, not the last one held
    alert: np.ndarray  # bool: the servo reports a hardware error


class Health(NamedTuple):
    """One servo's state other than its motion."""

    torque: bool
    errors: tuple[str, ...]  # of the hardware error status
    position_p_gain: int
    watchdog: int  # register; -1: it has tripped
    goal: int  # counts
    voltage: float  # V
    temperature: float  # degrees Celsius


VOLTAGE_ERROR = 0x01  # the first of these bits, of the register shutdown too
ERROR_BITS = {
    0: "input voltage",
    2: "overheating",
    3: "encoder",
    4: "electric shock",
    5: "overload",
}


def errors_of(status: int) -> tuple[str, ...]:
    """Return the names of the bits of a hardware error status; both makers share them."""
    return tuple(name for bit, name in ERROR_BITS.items() if status >> bit & 1)
