"""Whether servos that move are well: each check returns why to stop, or None.

watch = Watch(driver, StopLimits())
watch.begin(state)                          # what the servos report before their torque goes on
watch.reading(reading, expected)            # "hinge is at 0.10 rad and should be at 0.80: ..."
watch.health(0, driver.health(0))           # "hinge reports overload; find the reason"
"""

import math
from collections.abc import Sequence

import numpy as np

from hardware.config import Servo
from hardware.driver import Driver
from hardware.errors import ServoError, format_names
from hardware.readings import Health, Reading
from hardware.stop_limits import StopLimits, full_duty_errors

SentGoals = Sequence[tuple[float, np.ndarray]]  # s, and counts (n,)


class Watch:
    """Each servo's condition since it was armed.

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
        self._most = np.full(n, math.inf)  # A, or part of the full load
        self._seen = math.nan
        self._misses, self._unheard = np.zeros(n, int), np.zeros(n, int)
        self._astray, self._strained = np.zeros(n), np.zeros(n)  # s
        self._refused = np.zeros(n, int)

    def begin(self, state: Sequence[Health]) -> None:
        """Forget what was seen before, and read the limits that the servos have themselves.

        Raises:
            ServoError: a servo does not answer.
        """
        self.state = list(state)
        own = [self._driver.read_register(servo, "temperature_limit") for servo in self._servos]
        self._hottest = np.array(own) - self._limits.hottest
        self._most = np.array([self._most_effort(servo) for servo in self._servos])
        self._misses[:], self._unheard[:] = 0, 0
        self.settle()

    def settle(self) -> None:
        """Forget how far joints were from where they should be: they are to stay where they are."""
        self._astray[:], self._strained[:], self._refused[:] = 0, 0, 0

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
        over = (np.abs(reading.effort) > self._most) & reading.fresh
        self._strained = np.where(over, self._strained + passed, 0.0)
        i = int(np.argmax(self._strained))
        if self._strained[i] > limits.patience:
            return self._overload(i, abs(reading.effort[i]))
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

    def _most_effort(self, servo: Servo) -> float:
        """Return the largest current [A], or part of the full load, that a servo may report.

        The robot's file says it; a limit that the servo has itself holds, too.
        """
        kind = servo.type
        given = servo.load if kind.current is None else servo.current
        limits = [] if given is None else [given]
        if kind.current is not None and "current_limit" in kind.registers:
            own = self._driver.read_register(servo, "current_limit")
            limits.append(own * kind.current)
        return min(limits, default=math.inf)

    def _overload(self, i: int, effort: float) -> str:
        """Say how far over its limit a servo is."""
        unit, most = self._servos[i].type.current, self._most[i]
        what = f"is at {effort:.0%} of its load, over its limit of {most:.0%}"
        if unit is not None:
            what = f"draws {effort:.2f} A, over its limit of {most:.2f} A"
        since = f"for more than {self._limits.patience:g} s; find what it pushes against"
        return f"{self._names[i]} {what}, {since}"

    def trouble(self, i: int, health: Health | None) -> str:
        """Describe the error that a servo reports."""
        what = format_names(health.errors) if health else "a hardware error"
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
            return f"{name} reports {format_names(health.errors)}; find the reason"
        return None

    def climate(self, i: int, health: Health) -> str | None:
        """Return why the temperature or the supply of a servo under torque mean to stop."""
        name, volts = self._names[i], self._driver.robot.supply_of(self._servos[i]).voltage
        if health.temperature >= self._hottest[i]:
            return (
                f"{name} is at {health.temperature:.0f} °C; let it cool (at most "
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
        self._refused[i] = 0 if goal == newest[i] else self._refused[i] + 1
        if self._refused[i] < 2:
            return None
        words = f"{name} does not take its goals: it holds {goal}, {newest[i]} was sent"
        held = next((time for time, goals in reversed(sent) if goals[i] == goal), None)
        low, high = self._own_limits(i)
        if not low <= newest[i] <= high:
            return f"{words}; its own position limits are narrower than the robot's file says"
        if held is None:
            return f"{words}; another program may command it, or it refuses this goal"
        return f"{words} {1e3 * (now - held):.0f} ms later: the link is slow, or loses commands"

    def _own_limits(self, i: int) -> tuple[float, float]:
        """Return between which counts a servo takes goals, as far as it says so."""
        servo = self._servos[i]
        if self._driver.robot.mode_of(servo) != servo.type.position_mode:
            return -math.inf, math.inf  # other modes have no such limits
        names = ("min_position_limit", "max_position_limit")
        try:
            low, high = (self._driver.read_register(servo, name) for name in names)
        except ServoError:
            return -math.inf, math.inf
        return low, high
