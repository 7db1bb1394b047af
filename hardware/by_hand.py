"""Joints moved by hand with torque off: their ends, their zero, and the way that angles grow.

    hand = HandMeasurement(driver, ask_terminal)
    hand.measure(0)             # Travel(low=-1.71, high=1.69, zero=0.02, sign=1)

While a person moves a joint it is read again and again, so that joints which turn more than half a
turn, or over the seam of their encoder, are followed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hardware.calibration import SEAM
from hardware.command_line import UsageError
from hardware.driver import Driver
from hardware.errors import RobotError, SerialPortError, format_names
from hardware.terminal import Ask

SETTLE = 0.05  # s before the reading that counts
LONGEST = 5.0  # s that a new answer is waited for on a busy machine
LEAST = 0.03  # rad, that a hand moves a joint at least when it is asked to


class Travel(NamedTuple):
    """A joint as a hand showed it, in its driver's angles [rad]; sign is -1 if they fall."""

    low: float
    high: float
    zero: float
    sign: int


class HandMeasurement:
    """Asks for joints to be moved, and measures where they are.

    Args:
        driver: connected servos without torque.
        ask: asks the person.
    """

    def __init__(self, driver: Driver, ask: Ask) -> None:
        self._driver, self._ask = driver, ask

    def where(self, prompt: str, i: int) -> float:
        """Ask, follow the joints until the answer, and return where joint i is then [rad].

        Raises:
            UsageError: no one answers, or it was interrupted.
            SerialPortError: the joint's servo gives no new answer.
        """
        try:
            self._ask(prompt, self._driver.read)
        except EOFError:
            raise UsageError(
                "this needs a person at a terminal, but there is none; nothing was written"
            ) from None
        except KeyboardInterrupt:
            raise UsageError("interrupted; nothing was written") from None
        clock = self._driver.clock
        end = clock.now() + LONGEST
        clock.sleep_until(clock.now() + SETTLE)
        while not (reading := self._driver.read()).fresh[i] and clock.now() < end:
            clock.sleep_until(clock.now() + SETTLE)
        if not reading.fresh[i]:
            raise SerialPortError(f"{self._driver.robot.names[i]} did not answer; begin again")
        return float(reading.position[i])

    def measure(self, i: int, name: str | None = None) -> Travel:
        """Ask for the ends, the zero and the direction of a joint.

        Raises:
            UsageError, SerialPortError: as `where`.
            RobotError: the joint's servo counts within one turn, and the travel is not within it.

        Args:
            i: the joint's number in the robot.
            name: what to call it; None for its servo's name.
        """
        name = name or self._driver.robot.names[i]
        ends = [
            self.where(f"move {name} to {place}, then press Enter ", i)
            for place in ("one end of its range", "the other end")
        ]
        self._check_seam(i, ends, name)
        zero = self.where(f"move {name} to its zero, then press Enter ", i)
        up = zero
        while abs(up - zero) < LEAST:
            up = self.where(f"move {name} a little to where its angle grows, then press Enter ", i)
        return Travel(min(ends), max(ends), zero, -1 if up < zero else 1)

    def _check_seam(self, i: int, ends: Sequence[float], name: str) -> None:
        robot = self._driver.robot
        servo, whole = robot.servos[i], np.ones(len(robot.servos))
        goals = [int(self._driver.counts(end * whole)[i]) for end in ends]
        last = servo.type.units.counts_per_turn - 1
        if (
            robot.mode_of(servo) == servo.type.position_mode
            and not 0 <= min(goals) <= max(goals) <= last
        ):
            raise RobotError(f"{name}: from {min(goals)} to {max(goals)} of 0 to {last}: {SEAM}")

    def which(self, name: str, left: list[int]) -> int:
        """Ask for one joint to be moved, and return which of these servos moved.

        Raises:
            UsageError, SerialPortError: as `where`.
        """
        names, prompt = self._driver.robot.names, ""
        while True:
            start = self._driver.read().position
            prompt += f"move {name} a little, and nothing else, then press Enter "
            self.where(prompt, left[0])
            moved = np.abs(self._driver.read().position - start)
            first = int(moved.argmax())
            alone = np.delete(moved, first).max(initial=0.0) < moved[first] / 2
            if moved[first] > LEAST and alone and first in left:
                return first
            far = format_names(names[i] for i in np.flatnonzero(moved > LEAST))
            prompt = f"moved: {far}; one of {format_names(names[i] for i in left)} has to. "
