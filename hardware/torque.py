"""Torque of a robot's servos: on where they are, off and verified, off on a bus that was gone.

`powered` names the servos that may have torque: from before it is switched on until the servo
itself has confirmed that it is off.
"""

import logging
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from hardware.bus_client import MORE_PATIENT, BusClient
from hardware.clock import Clock
from hardware.config import Robot, Servo
from hardware.errors import SerialPortError, ServoError, format_names
from hardware.registers import RETRIES

_logger = logging.getLogger(__name__)
FIRST_PAUSE = 0.1  # s between attempts to reopen a port
LATEST = 0.2  # s, the longest that torque-off waits for an answer


class Torque:
    """The part of a driver that switches torque."""

    torque: ClassVar[int]  # address
    robot: Robot
    clock: Clock
    bus_client: BusClient
    _powered: set[str]

    @property
    def powered(self) -> set[str]:
        """The servos that may have torque, as far as is known."""
        return set(self._powered)

    def write_register(self, servo: Servo, name: str, value: int) -> None:
        """Write a register and read it back."""
        raise NotImplementedError

    def read_register(self, servo: Servo, name: str) -> int:
        """Read a register."""
        raise NotImplementedError

    def set_watchdogs(self, steps: int) -> None:
        """Let servos stop by themselves after a number of silent steps of 20 ms; 0 for never."""
        raise NotImplementedError

    def find_powered(self) -> None:
        """Look which servos have torque that an earlier program left on, and say so."""
        left, on = {servo.id: servo.name for servo in self.robot.servos}, set()
        for _ in range(RETRIES):
            for number, reply in self.bus_client.sync_read(self.torque, 1, [*left], False).items():
                name = left.pop(number)
                if any(reply.data):
                    on.add(name)
            if not left:
                break
        self._powered |= on
        if on:
            words = "%s: torque is on in %s, left on by an earlier program"
            _logger.warning(words, self.robot.name, format_names(sorted(on)))

    def mark_powered(self, servo: Servo) -> None:
        """Remember that a servo may have torque."""
        self._powered.add(servo.name)

    def torque_on(self, goals: np.ndarray) -> None:
        """Switch all torque on at these goals (n,) [counts], and verify.

        Each goal is read back before any torque goes on: a servo never drives to an old one.

        Raises:
            ServoError: a servo does not take its goal, or stays off; one that has shut itself down
                needs a reboot.
        """
        self.set_watchdogs(0)
        for servo, goal in zip(self.robot.servos, goals.tolist(), strict=True):
            self.write_register(servo, "goal_position", goal)
        self.set_watchdogs(self.robot.watchdog_steps)
        for servo in self.robot.servos:
            self.mark_powered(servo)
            try:
                self.write_register(servo, "torque_enable", 1)
            except ServoError as error:
                raise ServoError(
                    f"{servo.name} (ID {servo.id}): its torque stays off; if it shut itself down, "
                    "find the reason, then reboot it"
                ) from error

    def torque_off(self, times: float = MORE_PATIENT) -> None:
        """Switch all torque off, first all at once, then one by one until each has confirmed.

        Args:
            times: how much longer than usual each answer is waited for.

        Raises:
            ServoError: a servo did not confirm; it may still be powered: cut the supply.
        """
        self._verify_off(self.robot.servos, times)

    def _verify_off(self, servos: Sequence[Servo], times: float) -> None:
        """Tell all servos to switch torque off, and let each of these confirm it."""
        self.broadcast_torque_off()
        unsure = []
        with self.bus_client.more_patient(times):
            for servo in servos:
                self.mark_powered(servo)
                try:
                    self.write_register(servo, "torque_enable", 0)
                    self._powered.discard(servo.name)
                except ServoError:
                    unsure.append(servo.name)
        if unsure:
            raise ServoError(f"torque may still be on in {format_names(unsure)}: cut the supply")

    def broadcast_torque_off(self) -> None:
        """Broadcast torque-off to all servos without waiting for acknowledgement."""
        for _ in range(2):
            self.bus_client.write_all(self.torque, b"\x00")

    def torque_off_after_reconnect(self, patience: float) -> None:
        """Open the port again and again until torque is off, and verified, in every servo.

        Each attempt waits twice as long for answers as the one before: the link may be slow.

        Args:
            patience: how long to try [s].

        Raises:
            SerialPortError: the port did not come back in that time.
            ServoError: it did, or was never gone, but a servo did not confirm.
        """
        end, attempt = self.clock.now() + patience, 0
        while True:
            try:
                return self.reopen_and_switch_off(attempt)
            except SerialPortError:
                if self.clock.now() + FIRST_PAUSE > end:
                    raise
            except ServoError:
                attempt += 1
                if self.clock.now() + FIRST_PAUSE > end:
                    raise
            self.clock.sleep_until(self.clock.now() + FIRST_PAUSE)

    def reopen_and_switch_off(self, attempt: int = 0) -> None:
        """Reopen the port and switch off unconfirmed servos; raises as `torque_off`."""
        client = self.bus_client
        client.close()
        client.open(self.robot.bus.baud)
        most = max(LATEST / client.patience, MORE_PATIENT)
        left = [servo for servo in self.robot.servos if servo.name in self._powered]
        self._verify_off(left, min(MORE_PATIENT * 2.0**attempt, most))
