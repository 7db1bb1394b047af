"""Three emulated servos with faults, their driver and their guard."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar

import numpy as np

from hardware.clock import VirtualClock
from hardware.driver import Driver
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import World
from hardware.errors import HardwareError
from hardware.pace import Pace
from hardware.safety import Guard

START = 1.01  # s, when faults begin: after arming, between two control steps


class Rig:
    """Three emulated servos with faults, their driver and their guard, armed.

    `made` are those of one test; `conftest.py` ends them and looks that none is powered.
    """

    made: ClassVar[list[Rig]] = []

    def __init__(self, robot, faults=(), registers=None, believed=None, **guard) -> None:
        self.made.append(self)
        self.world = World(robot, faults=faults, registers=registers)
        self.clock = VirtualClock()
        self.port = LoopbackPort(self.world, self.clock)
        self.driver = Driver(believed or robot, self.port, self.clock)
        self.driver.connect()
        self.driver.configure()
        self.guard = Guard(self.driver, **guard)
        self.readings = []

    def run(self, steps: int, goal: float | Callable[[int], np.ndarray] = 0.0) -> None:
        """Arm if need be, and run the control loop."""
        if not self.guard.armed:
            self.guard.arm()
            period = 1 / self.driver.robot.rate
            self.clock.sleep_until(period * math.ceil(self.clock.now() / period))
        pace = Pace(self.clock, self.driver.robot.rate)
        for k in range(steps):
            pace.wait()
            self.readings.append(self.guard.read())
            angles = goal(k) if callable(goal) else np.full(len(self.driver), goal)
            self.sent = self.guard.command(angles)

    def end(self) -> None:
        """Stop as a program's end does, and look that no servo is left powered.

        Where the cable is out nothing can be switched off; the next program does so at its start.
        """
        if self.port.unplugged:
            self.port.unplugged = False
            self.start_again()
        elif hasattr(self, "guard"):
            self.guard.stop()
        assert not any(self.powered), "a servo was left powered"

    def start_again(self) -> None:
        """Do what the next program does first: look at all servos, and switch their torque off."""
        self.clock.sleep_until(max(self.clock.now(), self.world.time) + 1)
        self.driver.connect()
        self.driver.configure()

    @property
    def powered(self) -> list[bool]:
        """Which servos have torque."""
        return self.world.firmware.torque_on.tolist()

    def count(self, name: str) -> list[int]:
        """Return one counter of each servo."""
        return [getattr(self.driver.bus_client.counters[n], name) for n in self.driver.ids]

    def counted(self) -> tuple[dict[str, int], ...]:
        """Return what was counted of each servo beside requests and answers.

        Every request is answered, timed out, or answered by an error without data.
        """
        found = []
        for number in self.driver.ids:
            counters = self.driver.bus_client.counters[number]
            assert counters.asked - counters.answered == counters.timeout + counters.error
            kept = {k: v for k, v in counters.as_dict().items() if v}
            found.append({k: v for k, v in kept.items() if k not in ("asked", "answered")})
        return tuple(found)


def wave(k: int) -> np.ndarray:
    """Return a slow motion of three servos."""
    return np.full(3, 0.3 * np.sin(k / 10))


def in_real_time(action: Callable[[], None], attempts: int = 6) -> None:
    """Do what needs real time again if a busy machine spoiled it; the last attempt must succeed."""
    for attempt in range(attempts):
        try:
            return action()
        except HardwareError:
            if attempt == attempts - 1:
                raise
