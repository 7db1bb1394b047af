"""Feetech servos of one robot in SI units; see `hardware/driver.py`.

    driver = FeetechDriver(load_robot("so101"), port, clock)

One read takes registers 56 to 70 of all servos: position, velocity, duty, voltage, temperature,
errors and current. No counter says how old an answer is, and the sum that guards it has 8 bits: an
answer counts only if its servo can have turned so far since the last. The servos have no watchdog:
if this program is killed, they go on to their last goals and hold them. They apply a homing offset
of their own, such as LeRobot writes: it is read at `connect` and taken into account.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

import numpy as np

from hardware.bus_client import BusClient
from hardware.clock import Clock
from hardware.config import Robot
from hardware.driver import TURN, Driver, Values
from hardware.errors import ServoError
from hardware.feetech.bus_client import FeetechClient
from hardware.readings import Health, errors_of

if TYPE_CHECKING:
    from dynamixel_sdk import PortHandler

STATE, STATE_SIZE = 40, 31  # torque enable to present current
FASTEST = 2.0  # times the speed without load that no servo exceeds
MARGIN = 60.0  # counts beyond, for noise, play and late answers


class FeetechDriver(Driver):
    """The Feetech servos of a robot over a port.

    Args:
        robot: the robot's file, calibration applied.
        port: a port of dynamixel-sdk, or the emulator's.
        clock: source of the time.
    """

    client_type: ClassVar[type[BusClient]] = FeetechClient
    block: ClassVar[tuple[int, int]] = (56, 15)
    goal: ClassVar[int] = 42
    torque: ClassVar[int] = 40

    def __init__(self, robot: Robot, port: PortHandler, clock: Clock) -> None:
        super().__init__(robot, port, clock)
        self._raw_zero = self._zero.copy()
        self._when = np.full(len(self), np.nan)  # s, the last answer of each servo
        volts = np.array([robot.supply_of(servo).voltage for servo in robot.servos])
        constants = np.array([kind.torque_constant for kind in self._types])
        self._fastest = FASTEST * volts / constants / self._step  # counts/s

    def _adopt(self) -> None:
        """Read the offsets that the servos take off their encoders' counts."""
        for i, servo in enumerate(self.robot.servos):
            self._zero[i] = self._raw_zero[i] - self.read_register(servo, "homing_offset")
        self._when[:] = np.nan
        self._turns[:] = 0

    def _answers_fast(self) -> bool:
        return False

    def _decode(self, i: int, data: bytes, asked: float, received: float) -> Values | None:
        registers = self._types[i].registers
        start = self.block[0]

        def value(name: str) -> int:
            register = registers[name]
            return register.decode(data[register.address - start :])

        count = value("present_position")
        if not np.isnan(self._when[i]):
            turns = round((self._values[3, i] - count) / TURN)
            moved = abs(count + TURN * turns - self._values[3, i])
            if moved > self._fastest[i] * (received - self._when[i]) + MARGIN:
                self.bus_client.counters[self.ids[i]].corrupt += 1
                return None
            self._turns[i] += turns
        self._when[i] = asked
        return value("present_pwm"), value("present_current"), value("present_velocity"), count

    def health(self, i: int) -> Health | None:
        """Read one servo's state; None if it did not answer."""
        reply = self.bus_client.read(self.ids[i], STATE, STATE_SIZE)
        if reply is None or len(reply.data) != STATE_SIZE:
            return None
        kind, data = self._types[i], reply.data

        def value(name: str) -> int:
            register = kind.registers[name]
            return register.decode(data[register.address - STATE :])

        servo = self.robot.servos[i]
        gains = {**kind.defaults, **self.robot.registers_of(servo)}
        return Health(
            torque=bool(value("torque_enable")),
            errors=errors_of(value("hardware_error_status")),
            position_p_gain=gains["position_p_gain"],
            watchdog=0,
            goal=value("goal_position"),
            voltage=value("present_input_voltage") * kind.units.voltage,
            temperature=float(value("present_temperature")),
        )

    def set_watchdogs(self, steps: int) -> None:
        """Refuse any but 0: these servos have no watchdog.

        Raises:
            ServoError: another number.
        """
        if steps:
            raise ServoError(f"{self.robot.name}: its servos have no watchdog; set watchdog: 0")
