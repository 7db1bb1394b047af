"""A robot whose servos are on several buses, behind the interface of one driver.

    driver = MultiBusDriver(robot, [Driver(left, port, clock), FeetechDriver(right, other, clock)])
    driver.read()                           # all buses are asked before any answer is waited for

Each bus has its own driver, for the maker of its servos. What is asked of all servos goes out
on every bus before an answer is waited for, so that a step takes as long as the slowest bus, not as
all together. Torque-off is sent to every bus first, and then verified bus by bus, even if one
fails.
"""

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from hardware.bus_client import MORE_PATIENT
from hardware.config import Robot, Servo
from hardware.counters import Counters
from hardware.driver import Driver
from hardware.errors import SerialPortError, ServoError
from hardware.readings import Health, Reading
from hardware.torque import FIRST_PAUSE


class MultiBusDriver(Driver):
    """The servos of a robot over several ports.

    Args:
        robot: the robot's file, calibration applied.
        drivers: of its buses, for the robots of `robot.parts()`, in their order.
    """

    def __init__(self, robot: Robot, drivers: Sequence[Driver]) -> None:
        self.robot, self.clock = robot, drivers[0].clock
        self._drivers = list(drivers)
        self._where = [  # indices of each bus's servos in the robot's order
            np.array([robot.names.index(name) for name in part.robot.names]) for part in drivers
        ]
        self.score = None

    @property
    def powered(self) -> set[str]:
        """The servos that may have torque, as the drivers of the buses know it."""
        return set().union(*(part.powered for part in self._drivers))

    def mark_powered(self, servo: Servo) -> None:
        """Remember that a servo may have torque."""
        self._of(servo).mark_powered(servo)

    @property
    def parts(self) -> Sequence[Driver]:
        """The drivers of the robot's buses."""
        return self._drivers

    @property
    def counters(self) -> dict[str, Counters]:
        """The link counters of each servo, by its name."""
        found = {name: c for part in self._drivers for name, c in part.counters.items()}
        return {name: found[name] for name in self.robot.names}

    def connect(self) -> None:
        """Open every port and check every servo; see `Driver.connect`."""
        self.score = None
        for part in self._drivers:
            part.connect()
        self.fast = all(part.fast for part in self._drivers)

    def configure(self) -> None:
        """Torque off on every bus, then write the robot's registers; see `Driver.configure`."""
        self.torque_off()
        for part in self._drivers:
            part.configure()

    def begin_read(self) -> Callable[[], Reading]:
        """Ask the servos of every bus and return what waits for their answers."""
        begun = [part.begin_read() for part in self._drivers]
        return lambda: self._merged([finish() for finish in begun])

    def _merged(self, readings: Sequence[Reading]) -> Reading:
        def field(name: str) -> np.ndarray:
            parts = [getattr(reading, name) for reading in readings]
            whole = np.empty(len(self), parts[0].dtype)
            for where, part in zip(self._where, parts, strict=True):
                whole[where] = part
            return whole

        names = [name for name in Reading._fields if name != "time"]
        return Reading(time=readings[0].time, **{name: field(name) for name in names})

    def _each(
        self, values: np.ndarray, do: Callable[[Driver, np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """Let each bus's driver make of its part of the values, (n,), what `do` returns."""
        done = [do(d, values[w]) for d, w in zip(self._drivers, self._where, strict=True)]
        whole = np.empty(len(self), done[0].dtype)
        for where, part in zip(self._where, done, strict=True):
            whole[where] = part
        return whole

    def counts(self, angles: np.ndarray) -> np.ndarray:
        """Return the goal registers for these angles [rad], (n,) int64."""
        return self._each(np.asarray(angles, float), lambda part, own: part.counts(own))

    def angles(self, counts: np.ndarray) -> np.ndarray:
        """Return the angles [rad] of these goal registers, (n,)."""
        return self._each(np.asarray(counts), lambda part, own: part.angles(own))

    def command(self, angles: np.ndarray) -> np.ndarray:
        """Send goal angles [rad], (n,), and return them as the servos' resolution has them."""
        return self._each(np.asarray(angles, float), lambda part, own: part.command(own))

    def _of(self, servo: Servo) -> Driver:
        return next(part for part in self._drivers if servo.name in part.robot.names)

    def health(self, i: int) -> Health | None:
        """Read one servo's state; None without a new answer."""
        part = self._of(self.robot.servos[i])
        return part.health(part.robot.names.index(self.robot.names[i]))

    def write_register(self, servo: Servo, name: str, value: int) -> None:
        """Write a register and read it back; see `Driver.write_register`."""
        self._of(servo).write_register(servo, name, value)

    def read_register(self, servo: Servo, name: str) -> int:
        """Read a register; see `Driver.read_register`."""
        return self._of(servo).read_register(servo, name)

    def set_watchdogs(self, steps: int) -> None:
        """Let each servo that can stop by itself after a number of silent steps of 20 ms."""
        for part in self._drivers:
            part.set_watchdogs(steps if part.robot.watchdog else 0)

    def broadcast_torque_off(self) -> None:
        """Tell the servos of every bus to switch their torque off, whatever becomes of the others.

        Raises:
            SerialPortError: a port cannot be used; the others received it.
        """
        self._on_all(Driver.broadcast_torque_off)

    def torque_off(self, times: float = MORE_PATIENT) -> None:
        """Switch all torque off: first on every bus at once, then verified bus by bus.

        Args:
            times: how much longer than usual each answer is waited for.

        Raises:
            SerialPortError: a port cannot be used; on the others torque is off.
            ServoError: a servo did not confirm; it may still be powered: cut the supply.
        """
        failed = _failed(self._drivers, Driver.broadcast_torque_off)
        failed |= _failed(self._drivers, lambda part: part.torque_off(times))
        _raise(failed)

    def _on_all(self, action: Callable[[Driver], None]) -> None:
        _raise(_failed(self._drivers, action))

    def torque_off_after_reconnect(self, patience: float) -> None:
        """Switch torque off on the buses that are there, and on the others as soon as they are.

        Args:
            patience: how long to try [s].

        Raises:
            SerialPortError: a port did not come back in that time.
            ServoError: it did, or was never gone, but a servo did not confirm.
        """
        _failed(self._drivers, Driver.broadcast_torque_off)
        end, left, attempts = self.clock.now() + patience, self._drivers, itertools.count()
        while True:
            attempt = next(attempts)
            failed = _failed(left, lambda part, k=attempt: part.reopen_and_switch_off(k))
            left = list(failed)
            if not failed or self.clock.now() + FIRST_PAUSE > end:
                return _raise(failed)
            self.clock.sleep_until(self.clock.now() + FIRST_PAUSE)

    def cycle_time(self) -> float:
        """Return how long commanding and reading takes: as long as on the slowest bus [s]."""
        return max(part.cycle_time() for part in self._drivers)

    def close(self) -> None:
        """Close every port; torque stays as it is."""
        for part in self._drivers:
            part.close()


def _failed(
    drivers: Sequence[Driver], action: Callable[[Driver], None]
) -> dict[Driver, SerialPortError | ServoError]:
    """Do something on every bus, and return those where it failed, and why."""
    failed = {}
    for part in drivers:
        try:
            action(part)
        except (SerialPortError, ServoError) as error:
            failed[part] = error
    return failed


def _raise(failed: dict[Driver, SerialPortError | ServoError]) -> None:
    """Raise what failed, if anything did: all of it in one error."""
    if not failed:
        return
    words = "; ".join(str(error) for error in failed.values())
    kind = (
        SerialPortError
        if any(isinstance(e, SerialPortError) for e in failed.values())
        else ServoError
    )
    raise kind(words)
