"""Which angles a servo can be commanded to in position mode: one turn of its encoder."""

from __future__ import annotations

from collections.abc import Mapping

from hardware.errors import RobotError
from hardware.parts import Servo


def check_reach(servo: Servo, registers: Mapping[str, int], place: str) -> None:
    """Refuse angles beyond the one turn that a servo in position mode can be commanded to.

    Where that turn begins is moved by a Feetech servo's homing offset, which its driver reads.

    Args:
        servo: the servo.
        registers: what is written to it.
        place: its key in the robot's file.

    Raises:
        RobotError: the servo's limits are not within that turn; with what it can reach.
    """
    kind = servo.type
    mode = registers.get("operating_mode", kind.position_mode)
    ends, last = sorted(map(servo.count, servo.position)), kind.units.counts_per_turn - 1
    first = 0 if kind.maker == "dynamixel" else ends[0]
    if mode != kind.position_mode or (first <= ends[0] and ends[1] <= first + last):
        return
    low, high = sorted((servo.angle(first), servo.angle(first + last)))
    raise RobotError(
        f"{place}: position {list(servo.position)}: with its zero at {servo.zero:g} the servo can "
        f"be commanded from {low:.3f} to {high:.3f} rad; narrow it, or mount the horn elsewhere"
    )
