"""When the guard stops a robot, and when it does not arm one: each threshold is a setting.

Guard(driver, StopLimits(odd_voltage=0.3))
"""

from dataclasses import dataclass

import numpy as np

from hardware.config import Robot, Servo

PARTS = ("slow_steps", "longest_pause", "lost", "stale")  # of a whole: at most 1


@dataclass(frozen=True)
class StopLimits:
    """When to stop, and when not to arm.

    Args:
        misses: number of consecutive readings without one servo's answer after which it stops.
        hottest: stop this far below the servo's temperature limit, read from its register [K].
        stray: stop when a joint is this far from its command [rad], or so far that a soft servo
            drives at full duty if that is further, for longer than `patience`.
        patience: how long a joint may stray, or a servo be over its limit of current or load [s].
        outside: arm only if no joint is further outside its limits than this [rad]; the first
            commands then lead it back in.
        odd_voltage: stop when the supply differs from the robot's file by this part of it.
        return_time: how long to retry a bus that disappeared, for torque-off [s].
        slow_steps: arm only if at most this part of the control steps takes longer than their
            period. Judgement; not studied.
        longest_pause: arm only if no pause between steps takes more than this part of the servos'
            watchdog. Judgement: half of it is left for what a rehearsal of a second does not meet.
        lost: arm only if at most this part of one servo's answers is lost. Derived: a reading
            without an answer is repeated at once, so that `misses` = 5 in a row have a probability
            of 0.05^10 = 1e-13.
        stale: arm only if at most this part of one servo's answers is of an earlier question. As
            many held readings shift a joint's recorded motion by 0.05 of a step on average.
    """

    misses: int = 5
    hottest: float = 5.0
    stray: float = 0.5
    patience: float = 0.5
    outside: float = 0.2
    odd_voltage: float = 0.2
    return_time: float = 4.0
    slow_steps: float = 0.05
    longest_pause: float = 0.5
    lost: float = 0.05
    stale: float = 0.05


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
