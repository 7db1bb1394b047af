"""Whether servos that move are well: each check returns why to stop, or None.

watch = Watch(driver, StopLimits())
watch.begin(state)                          # what the servos report before their torque goes on
watch.reading(reading, expected)            # "hinge is at 0.10 rad and should be at 0.80: ..."
watch.health(0, driver.health(0), goal, ...)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hardware.driver import Driver
from hardware.errors import listed
from hardware.readings import Health, Reading
from hardware.stop_limits import StopLimits, full_duty_errors

SentGoals = Sequence[tuple[float, np.ndarray]]  # s, and counts (n,)


class Watch:
    """What was seen of each servo since it was armed.

    Args:
        driver: the servos.
        limits: when to stop.
    """

    def __init__(self, driver: Driver, limits: StopLimits) -> None:
        self._driver, self._limits = driver, limits
        robot, n = driver.robot, len(driver)
        self.state: list[Health | None] = [None] * n  # the newest of each servo
        self._servos, self._names = robot.servos, robot.names
        self._stray = np.maximum(limits.stray, full_duty_errors(robot))
        self._hottest = np.full(n, math.inf)  # degrees Celsius
        self._seen = math.nan
        self._misses, self._unheard = np.zeros(n, int), np.zeros(n, int)
        self._astray, self._refused = np.zeros(n), np.zeros(n, int)
        self._held = np.zeros(n, np.int64)  # goals at the last look [counts]

    def begin(self, state: Sequence[Health]) -> None:
        """Forget what was seen before, and read the limits that the servos have themselves.

        Raises:
            ServoError: a servo does not answer.
        """
        self.state = list(state)
        own = [self._driver.read_register(servo, "temperature_limit") for servo in self._servos]
        self._hottest = np.array(own) - self._limits.hottest
        self._misses[:], self._unheard[:] = 0, 0
        self.settle()

    def settle(self) -> None:
        """Forget how far joints were from where they should be: they are to stay where they are."""
        self._astray[:], self._refused[:] = 0, 0

    def reading(self, reading: Reading, expected: np.ndarray | None) -> str | None:
        """Return why a reading means to stop.

        Args:
            reading: of all servos.
            expected: the last command [rad], (n,); None while no servo follows one.
        """
        limits, names = self._limits, self._names
        self._misses = np.where(reading.fresh, 0, self._misses + 1)
        if self._misses.max() >= limits.misses:
            name = names[int(np.argmax(self._misses))]
            return f"{name} gave no new answer {limits.misses} times in a row"
        passed = 0.0 if math.isnan(self._seen) else reading.time - self._seen
        self._seen = reading.time
        if expected is None:
            return None
        far = np.abs(reading.position - expected) > self._stray
        self._astray = np.where(far & reading.fresh, self._astray + passed, 0.0)
        i = int(np.argmax(self._astray))
        if self._astray[i] > limits.patience:
            return (
                f"{names[i]} is at {reading.position[i]:.2f} rad and should be at "
                f"{expected[i]:.2f}: it is stuck, or its horn slipped"
            )
        return None

    def trouble(self, i: int, health: Health | None) -> str:
        """Return what a servo that reports an error says it is."""
        what = listed(health.errors) if health else "a hardware error"
        return f"{self._names[i]} reports {what}; find the reason, then reboot it"

    def health(self, i: int, health: Health | None) -> str | None:
        """Return why one servo's state means to stop, whether it is to have torque or not."""
        name, limits = self._names[i], self._limits
        self._unheard[i] = 0 if health else self._unheard[i] + 1
        self.state[i] = health or self.state[i]
        if health is None:
            silent = self._unheard[i] >= limits.misses
            return f"{name} does not report its state" if silent else None
        if health.errors:
            return f"{name} reports {listed(health.errors)}; find the reason"
        return None

    def climate(self, i: int, health: Health) -> str | None:
        """Return why the temperature or the supply of a servo under torque mean to stop."""
        name, volts = self._names[i], self._driver.robot.supply.voltage
        if health.temperature >= self._hottest[i]:
            return (
                f"{name} has {health.temperature:.0f} °C; let it cool (at most "
                f"{self._hottest[i]:.0f}: its own limit less stops.hottest)"
            )
        if abs(health.voltage - volts) > self._limits.odd_voltage * volts:
            return f"{name} has {health.voltage:.1f} V, not {volts:.1f} V: the supply"
        return None

    def obedience(self, i: int, health: Health, sent: SentGoals, pause: float) -> str | None:
        """Return why a servo that is to have torque does not do what it is commanded.

        Args:
            i: its number.
            health: its state.
            sent: what was sent, the newest last.
            pause: the longest time without a command [s].
        """
        name = self._names[i]
        if health.watchdog < 0:
            allowed = 1e3 * self._driver.robot.watchdog
            return (
                f"{name}: its bus watchdog tripped: {1e3 * pause:.0f} ms went by without a "
                f"command, and {allowed:.0f} ms are allowed"
            )
        if not health.torque:
            return f"{name} has no torque: it rebooted; configure and arm again"
        (now, newest), goal = sent[-1], health.goal
        moves_on, self._held[i] = goal != self._held[i], goal
        self._refused[i] = 0 if goal == newest[i] else self._refused[i] + 1
        if self._refused[i] < 2:
            return None
        held = next((time for time, goals in reversed(sent) if goals[i] == goal), None)
        if held is not None and moves_on:
            return (
                f"{name} holds the goal of {1e3 * (now - held):.0f} ms before the newest: the link "
                "is slow, or loses commands"
            )
        return (
            f"{name} does not take its goals: it holds {goal}, {newest[i]} was sent; its own "
            "position limits may be narrower than the robot's file says"
        )
