"""What servos do by themselves once commands stop.

    alone(robot, robot.names)
    # "'hip', 'knee' (each stops after 0.1 s by its watchdog, then holds its position with torque)"

A tripped bus watchdog of the X series holds in the position modes, and lets go in current mode.
Feetech servos have none.
"""

from collections.abc import Iterable

from hardware.config import Robot, Servo
from hardware.errors import format_names
from hardware.robot import WATCHDOG_STEP

CURRENT_MODE = 0  # operating mode; the others hold or brake


def alone(robot: Robot, names: Iterable[str]) -> str:
    """Say what each of these servos does when commands stay away, those alike together."""
    groups: dict[str, list[str]] = {}
    for servo in robot.servos:
        if servo.name in set(names):
            groups.setdefault(_habit(robot, servo), []).append(servo.name)
    return " and ".join(f"{format_names(each)} (each {habit})" for habit, each in groups.items())


def _habit(robot: Robot, servo: Servo) -> str:
    if robot.watchdog == 0 or servo.type.maker == "feetech":
        return "has no watchdog, continues to its last goal and holds it with torque"
    ends = "lets go" if robot.mode_of(servo) == CURRENT_MODE else "holds its position with torque"
    return f"stops after {robot.watchdog_steps * WATCHDOG_STEP:g} s by its watchdog, then {ends}"
