"""When the guard stops a robot: the thresholds, each a setting of its own.

Guard(driver, StopLimits(odd_voltage=0.3))
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hardware.config import Robot, Servo


@dataclass(frozen=True)
class StopLimits:
    """When to stop.

    Args:
        misses: stop after so many readings in a row without one servo's answer.
        hottest: stop this far below the servo's temperature limit, read from its register [K].
        stray: stop when a joint is this far from its command [rad], or so far that a soft servo
            drives at full duty if that is further, for longer than `patience`.
        patience: how long a joint may stray, or a servo be over its limit of current or load [s].
        outside: arm only if no joint is further outside its limits than this [rad]; the first
            commands then lead it back in.
        odd_voltage: stop when the supply differs from the robot's file by this part of it.
        return_time: how long to retry a bus that disappeared, for torque-off [s].
    """

    misses: int = 5
    hottest: float = 5.0
    stray: float = 0.5
    patience: float = 0.5
    outside: float = 0.2
    odd_voltage: float = 0.2
    return_time: float = 4.0


def full_duty_errors(robot: Robot) -> np.ndarray:
    """Return how far from its goal each position loop drives at full duty [rad], (n,).

    Short of that a soft servo may merely sag under its load.
    """
    return np.array([_full_duty_error(robot, servo) for servo in robot.servos])


def _full_duty_error(robot: Robot, servo: Servo) -> float:
    kind = servo.type
    gain = {**kind.defaults, **robot.registers_of(servo)}.get("position_p_gain", 0)
    counts = kind.units.full_pwm * kind.gain_divisor / gain if gain else 0.0
    return counts * kind.units.angle
