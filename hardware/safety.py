"""The only hand that moves a robot: limits on every command, and torque off whatever happens.

    with Guard(driver) as guard:            # torque off at the end, also on Ctrl-C and exceptions
        guard.arm()                         # safe start: goal = present position, then torque on
        guard.move_to(start, speed=0.5)     # slowly to where the episode starts
        while True:
            pace.wait()
            reading = guard.read()
            sent = guard.command(angles)    # Sent(angles, limited): what was really sent, and why

A command is refused if it is not finite, clamped to each joint's limits, and moved from the last
command by at most `max_step` and the joint's velocity. The robot is stopped, torque off and
verified, with a SafetyError that says why, when answers fail to come, a servo reports an error,
starts anew, gets too hot, has its watchdog trip, does not take its goals or does not follow them.
While armed, the servos' own watchdogs stop them if this program dies.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from types import TracebackType
from typing import Any, NamedTuple, NoReturn, Self

import numpy as np

from hardware.driver import Driver, Health, Reading
from hardware.ending import Ending
from hardware.errors import LineError, SafetyError, ServoError, listed
from hardware.pace import Pace
from hardware.stop_limits import StopLimits, full_duty_errors

_logger = logging.getLogger(__name__)


class Sent(NamedTuple):
    """A command as it was sent: angles [rad], (n,), and for each why it is not what was asked."""

    angles: np.ndarray
    limited: tuple[str, ...]  # "", "limit", "step"


class Guard:
    """Arms, commands, watches and stops the servos of a driver.

    Args:
        driver: connected and configured servos.
        limits: when to stop.
        dry_run: read and check everything, but write no goal and no torque.
    """

    def __init__(
        self, driver: Driver, limits: StopLimits | None = None, dry_run: bool = False
    ) -> None:
        self.driver, self.limits, self.dry_run = driver, limits or StopLimits(), dry_run
        robot = driver.robot
        self.armed = False
        self._slack = False  # armed, but limp for a swing
        self.low = np.array([servo.position[0] for servo in robot.servos])
        self.high = np.array([servo.position[1] for servo in robot.servos])
        speed = np.array([servo.velocity for servo in robot.servos])
        self.most_step = np.minimum(robot.max_step, speed / robot.rate)
        self.last: np.ndarray | None = None  # the last command [rad], (n,)
        self.health: list[Health | None] = [None] * len(driver)  # the newest of each servo
        self._stray = np.maximum(self.limits.stray, full_duty_errors(robot))
        self._goals = np.zeros(len(driver), np.int64)
        self._commanded, self._pause = math.nan, 0.0  # s: the last command, the longest pause
        self._misses = np.zeros(len(driver), int)
        self._astray = np.zeros(len(driver))
        self._seen = math.nan
        self._turn = 0
        self._unheard = np.zeros(len(driver), int)
        self._hopeless = np.zeros(len(driver), int)
        self._ending = Ending(self.stop)

    def __enter__(self) -> Self:
        self._ending.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ending.__exit__(kind, error, trace)

    def arm(self) -> Reading:
        """Switch torque on without a movement, and return where the robot is.

        Raises:
            SafetyError: a servo is outside its limits, or reports an error.
            ServoError: this machine or port is too slow for the robot's rate or watchdog, or a
                servo does not follow its command; torque is off again.
        """
        driver = self.driver
        driver.rehearse()
        reading = self._whole_reading()
        self._check_start(reading)
        self.health = [driver.health(i) for i in range(len(driver))]
        self.last = reading.position.copy()
        if self.dry_run:
            self.armed = True
            return reading
        try:
            driver.set_watchdogs(0)
            for servo, goal in zip(driver.robot.servos, reading.count.tolist(), strict=True):
                driver.write_register(servo, "goal_position", goal)
            self._goals = reading.count.copy()
            driver.set_watchdogs(round(driver.robot.watchdog / 0.02))
            self.armed = True
            driver.torque_on()
        except (ServoError, LineError):
            self.armed = True
            self.stop()
            raise
        self._misses[:], self._astray[:], self._unheard[:] = 0, 0, 0
        self._hopeless[:] = 0
        self._commanded, self._pause = driver.clock.now(), 0.0
        return reading

    def command(self, angles: np.ndarray) -> Sent:
        """Send what is safe of the wanted angles [rad], (n,), and return what was sent.

        Raises:
            SafetyError: the robot is not armed, or an angle is not finite; the robot is stopped.
        """
        if not self.armed or self.last is None:
            raise SafetyError("the robot is not armed; call arm() first")
        wanted = np.asarray(angles, float)
        if wanted.shape != self.last.shape or not np.isfinite(wanted).all():
            self._stop_for(f"the command {wanted} is not {len(self.last)} finite angles")
        allowed = np.clip(wanted, self.low, self.high)
        sent = np.clip(allowed, self.last - self.most_step, self.last + self.most_step)
        limited = np.where(sent != allowed, "step", np.where(allowed != wanted, "limit", ""))
        if self._slack:
            raise SafetyError("the robot is limp; call stiffen() before the next command")
        self.last = exact = sent
        if not self.dry_run:
            sent = self._do(lambda: self.driver.command(exact))
            self._time_command()
            self._goals = self.driver.counts(sent)
        return Sent(sent, tuple(limited.tolist()))

    def _time_command(self) -> None:
        now = self.driver.clock.now()
        if not math.isnan(self._commanded):
            self._pause = max(self._pause, now - self._commanded)
        self._commanded = now

    def read(self) -> Reading:
        """Read all servos, and one servo's health in turn; stop if something is wrong.

        Raises:
            SafetyError: with the servo and the reason; the robot is stopped.
        """
        reading = self.measure()
        self.inspect()
        return reading

    def measure(self) -> Reading:
        """Read all servos; stop if one is silent, in trouble or astray. A part of `read`.

        Raises:
            SafetyError: with the servo and the reason; the robot is stopped.
        """
        reading = self._do(self.driver.read)
        if self.armed:
            self._check_reading(reading)
        return reading

    def inspect(self) -> None:
        """Ask the next servo in turn for its health; stop if it is not well. A part of `read`.

        Raises:
            SafetyError: with the servo and the reason; the robot is stopped.
        """
        if self.armed:
            self._turn = (self._turn + 1) % len(self.driver)
            self._check_health(self._turn, self._do(lambda: self.driver.health(self._turn)))

    def move_to(self, angles: np.ndarray, speed: float = 0.5) -> Reading:
        """Go to a pose [rad], (n,), at this speed [rad/s], and return the last reading.

        Raises:
            SafetyError: something went wrong on the way; the robot is stopped.
        """
        rate = self.driver.robot.rate
        pace = Pace(self.driver.clock, rate)
        goal = np.clip(np.asarray(angles, float), self.low, self.high)
        reading = self.read()
        while self.last is not None and np.abs(goal - self.last).max() > 1e-3:
            pace.wait()
            reading = self.read()
            step = np.clip(goal - self.last, -speed / rate, speed / rate)
            before = self.last
            self.command(self.last + step)
            if np.array_equal(before, self.last) and np.abs(step).max() < 2e-3:
                break
        return reading

    def limp(self) -> None:
        """Switch torque off for a swing; the robot stays armed and watched.

        Raises:
            SafetyError: the robot is not armed, or a servo did not confirm.
        """
        if not self.armed:
            raise SafetyError("the robot is not armed; call arm() first")
        if not self.dry_run:
            self._switch(self.driver.torque_off)
        self._slack = True

    def stiffen(self) -> Reading:
        """Switch torque on again where the robot is, and return the reading it holds.

        Raises:
            SafetyError: a joint is outside its limits, or a servo does not obey.
        """
        driver = self.driver
        reading = self._whole_reading()
        self._slack = False
        edge = self.limits.outside
        outside = (reading.position < self.low - edge) | (reading.position > self.high + edge)
        if outside.any():
            i = int(np.argmax(outside))
            name, angle = driver.robot.names[i], reading.position[i]
            self._stop_for(f"{name} swung to {angle:.2f} rad, outside its limits")
        self.last = reading.position.copy()
        self._goals = reading.count.copy()
        if not self.dry_run:
            self._do(lambda: driver.command(reading.position))
            self._switch(driver.torque_on)
        self._astray[:], self._hopeless[:] = 0, 0
        return reading

    def _switch(self, action: Callable[[], None]) -> None:
        try:
            self._do(action)
        except ServoError as error:
            self._stop_for(str(error))

    def stop(self) -> None:
        """Switch torque off and verify; safe to call at any time, as often as you like.

        A bus that is gone is tried again for `return_time`.

        Raises:
            ServoError: a servo did not confirm; it may still be powered: cut the supply.
        """
        if not self.armed or self.dry_run:
            self.armed = False
            return
        self.armed = self._slack = False
        try:
            self.driver.torque_off()
        except (LineError, ServoError) as error:
            self._switch_off_when_back(error)

    def _switch_off_when_back(self, reason: Exception) -> None:
        """Switch torque off on a bus that is gone, as soon as it is back.

        Raises:
            ServoError: it did not come back, or a servo did not confirm.
        """
        patience = self.limits.return_time
        _logger.error("%s; trying for %g s to switch torque off", reason, patience)
        try:
            self.driver.torque_off_when_back(patience)
        except (LineError, ServoError) as error:
            raise ServoError(
                f"torque could not be switched off within {patience:g} s ({error}); "
                f"{self._watchdogs}: cut the supply"
            ) from error

    @property
    def _watchdogs(self) -> str:
        """What the servos do by themselves when nobody commands them."""
        span = self.driver.robot.watchdog
        if span == 0:
            return "the servos have no watchdog and continue to their last goals"
        return f"the servos' watchdogs stop them after {span:g} s, but keep them powered"

    def _whole_reading(self) -> Reading:
        """Read until every servo has answered anew."""
        for _ in range(10):
            reading = self.driver.read()
            if reading.fresh.all():
                return reading
            self.driver.clock.sleep_until(self.driver.clock.now() + 0.01)
        silent = [
            n for n, new in zip(self.driver.robot.names, reading.fresh, strict=True) if not new
        ]
        raise SafetyError(f"no answers from {listed(silent)}: torque stays off")

    def _check_start(self, reading: Reading) -> None:
        edge = self.limits.outside
        for i, servo in enumerate(self.driver.robot.servos):
            q = reading.position[i]
            if not servo.position[0] - edge <= q <= servo.position[1] + edge:
                raise SafetyError(
                    f"{servo.name} is at {q:.3f} rad, outside its limits {list(servo.position)} "
                    f"by more than {edge:g}; move it by hand, or calibrate"
                )
            if reading.alert[i]:
                health = self.driver.health(i)
                what = listed(health.errors) if health else "an error"
                raise SafetyError(f"{servo.name} reports {what}: find the reason, then reboot it")

    def _check_reading(self, reading: Reading) -> None:
        limits, names = self.limits, self.driver.robot.names
        self._misses = np.where(reading.fresh, 0, self._misses + 1)
        if self._misses.max() >= limits.misses:
            name = names[int(np.argmax(self._misses))]
            self._stop_for(f"{name} gave no new answer {limits.misses} times in a row")
        if reading.alert.any():
            i = int(np.argmax(reading.alert))
            health = self._do(lambda: self.driver.health(i))
            what = listed(health.errors) if health else "a hardware error"
            self._stop_for(f"{names[i]} reports {what}; find the reason, then reboot it")
        now = reading.time
        passed = 0.0 if math.isnan(self._seen) else now - self._seen
        self._seen = now
        if self.last is not None and not self.dry_run and not self._slack:
            far = np.abs(reading.position - self.last) > self._stray
            self._astray = np.where(far & reading.fresh, self._astray + passed, 0.0)
            if self._astray.max() > limits.patience:
                i = int(np.argmax(self._astray))
                self._stop_for(
                    f"{names[i]} is at {reading.position[i]:.2f} rad and should be at "
                    f"{self.last[i]:.2f}: it is stuck, or its horn slipped"
                )

    def _check_health(self, i: int, health: Health | None) -> None:
        servo, limits = self.driver.robot.servos[i], self.limits
        self._unheard[i] = 0 if health else self._unheard[i] + 1
        self.health[i] = health or self.health[i]
        if health is None:
            if self._unheard[i] >= limits.misses:
                self._stop_for(f"{servo.name} does not report its state")
            return
        limit = servo.type.defaults["temperature_limit"] - limits.hottest
        volts = self.driver.robot.supply.voltage
        if health.errors:
            self._stop_for(f"{servo.name} reports {listed(health.errors)}; find the reason")
        if self._slack:
            return
        if not self.dry_run and health.watchdog < 0:
            pause, allowed = 1e3 * self._longest_pause(), 1e3 * self.driver.robot.watchdog
            self._stop_for(
                f"{servo.name}: its bus watchdog tripped: {pause:.0f} ms went by without a "
                f"command, and {allowed:.0f} ms are allowed"
            )
        if not self.dry_run and not health.torque:
            self._stop_for(f"{servo.name} has no torque: it rebooted; configure and arm again")
        if health.temperature >= limit:
            self._stop_for(f"{servo.name} has {health.temperature:.0f} °C; let it cool")
        if abs(health.voltage - volts) > limits.odd_voltage * volts:
            self._stop_for(
                f"{servo.name} has {health.voltage:.1f} V, not {volts:.1f} V: the supply"
            )
        self._hopeless[i] = 0 if health.goal == self._goals[i] else self._hopeless[i] + 1
        if not self.dry_run and self._hopeless[i] >= 2:
            self._stop_for(
                f"{servo.name} does not take its goals: it holds {health.goal}, {self._goals[i]} "
                "was sent; its own position limits may be narrower than the robot's file says"
            )

    def _longest_pause(self) -> float:
        """The longest time without a command since arming, the present one included [s]."""
        since = self.driver.clock.now() - self._commanded
        return self._pause if math.isnan(since) else max(self._pause, since)

    def _do(self, action: Callable[[], Any]) -> Any:
        """Talk to the servos; if the bus is gone, switch off as soon as it is back."""
        try:
            return action()
        except LineError as error:
            if not self.armed or self.dry_run:
                raise SafetyError(str(error)) from error
            self.armed = self._slack = False
            try:
                self._switch_off_when_back(error)
            except ServoError as still:
                raise SafetyError(f"{error}; {still}") from error
            raise SafetyError(f"{error}; it came back, and torque is off") from error

    def give_up(self, reason: str) -> NoReturn:
        """Stop the robot for a reason that its servos do not know, and raise it."""
        self._stop_for(reason)

    def _stop_for(self, reason: str) -> NoReturn:
        """Stop the robot and raise the reason."""
        _logger.error("stopped: %s", reason)
        try:
            self.stop()
        except ServoError as error:
            raise SafetyError(f"{reason}; and {error}") from error
        raise SafetyError(f"{reason}; the robot was stopped, torque is off")
