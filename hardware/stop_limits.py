"""Thresholds at which the guard stops a robot, or does not arm it.

Guard(driver, StopLimits(odd_voltage=0.3))
"""

from dataclasses import dataclass

import numpy as np

from hardware.config import Robot, Servo

PARTS = ("slow_steps", "longest_pause", "lost", "stale")  # of a whole: at most 1


@dataclass(frozen=True)
class StopLimits:
    """Thresholds for stopping and for arming.

    Args:
        misses: stop after this number of consecutive readings without an answer from one servo.
        hottest: stop at this distance below the servo's temperature limit register [K].
        stray: stop if a joint is this far from its command [rad] for longer than `patience`. For a
            soft servo, the limit is at least the error at which it drives at full duty.
        patience: time for which a joint may stray, or a servo exceed its current or load limit [s].
        outside: arm only if no joint is further outside its limits [rad]; the motion to the start
            then moves it back inside.
        odd_voltage: stop if the supply differs from the robot's file by this fraction.
        return_time: time for which a lost bus is retried to switch torque off [s].
        slow_steps: arm only if at most this fraction of the control steps takes longer than their
            period. This is a judgement; it was not studied.
        longest_pause: arm only if no pause between steps exceeds this fraction of the servos'
            watchdog. Judgement: the other half is a margin beyond a rehearsal of one second.
        lost: arm only if at most this fraction of a servo's answers is lost. Derived: a reading
            without an answer is repeated once immediately, so `misses` = 5 in a row have a
            probability of 0.05^10 = 1e-13.
        stale: arm only if at most this fraction of a servo's answers belongs to an earlier
            request. At 5 %, held readings shift a joint's motion by 0.05 steps on average.
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
