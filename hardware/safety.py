"""The only code that moves a robot: it limits commands and always switches torque off.

    with Guard(driver) as guard:            # torque off at the end, also on Ctrl-C and exceptions
        guard.arm()                         # safe start: goal = present position, then torque on
        guard.move_to(start, speed=0.5)     # slowly to the start of the episode
        while True:
            pace.wait()
            reading = guard.read()
            sent = guard.command(angles)    # Sent(angles, limited): the command as sent, and why

A command is refused if it is not finite, clamped to each joint's limits (from just outside them it
leads back or stays), and moved from the last command by at most `max_step` and the joint's
velocity. The robot is stopped, with torque off and verified, if answers are missing, or if a servo
reports an error, restarts, overheats, trips its watchdog, or does not accept or follow its goals. A
SafetyError contains the reason. While armed, the servos' own watchdogs stop them if this program
ends.
"""

import logging
import math
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple, NoReturn, Self

import numpy as np

from hardware.driver import Driver, Health, Reading
from hardware.errors import HardwareError, SafetyError, SerialPortError, ServoError, format_names
from hardware.pace import FixedRate
from hardware.shutdown import ShutdownHook
from hardware.stop_limits import StopLimits
from hardware.watch import Watch
from hardware.watchdog import alone

REMEMBERED = 100  # commands
ASKED = 10  # times that a servo is asked before its torque goes on
_logger = logging.getLogger(__name__)


class Sent(NamedTuple):
    """A command as it was sent: angles [rad], (n,), and for each why it is not what was asked."""

    angles: np.ndarray
    limited: tuple[str, ...]  # "", "limit", "step"


class Guard:
    """Arms, commands, watches and stops the servos of a driver.

    Args:
        driver: connected and configured servos.
        limits: thresholds for stopping.
        dry_run: read and check everything, but write neither goals nor torque.
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
        self.max_step = np.minimum(robot.max_step, speed / robot.rate)
        self.last: np.ndarray | None = None  # the last command [rad], (n,)
        self._sent: deque[tuple[float, np.ndarray]] = deque(maxlen=REMEMBERED)  # s, counts (n,)
        self._commanded, self._pause = math.nan, 0.0  # s: the last command, the longest pause
        self._turn = 0
        self._watch = Watch(driver, self.limits)
        self._ending = ShutdownHook(self.stop)

    def __enter__(self) -> Self:
        self._ending.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._ending.__exit__(*error)

    @property
    def health(self) -> list[Health | None]:
        """Newest state of each servo."""
        return self._watch.state

    def arm(self) -> Reading:
        """Switch torque on without moving, and return the reading.

        Raises:
            SafetyError: a servo is outside its limits, too hot, not at the voltage in the robot's
                file, or reports an error.
            ServoError: the link score is below 0 (see `hardware/rehearsal.py`), or a servo does not
                follow its command.
            HardwareError: after any error torque is off, or the message names the servos where it
                may still be on.
        """
        try:
            return self._arm()
        except HardwareError as error:
            self._stop_after(error)
            raise

    def _arm(self) -> Reading:
        driver = self.driver
        score = driver.measure_link(self.limits)
        if score is not None and not score.go:
            raise ServoError(f"{score}; torque stays off")
        reading = self._whole_reading()
        self._check_start(reading)
        states = [self._state(i) for i in range(len(driver))]
        self._watch.begin(states)
        for reason in map(self._watch.climate, range(len(driver)), states):
            if reason is not None:
                raise SafetyError(f"{reason}; torque stays off")
        if driver.robot.port is None and not self.armed:
            _logger.info("%s is emulated: it has no port", driver.robot.name)
        if not (self.armed or self.dry_run):
            level = logging.INFO if driver.robot.port is None else logging.WARNING
            words = "torque goes on; killed, or on a bus that stays away, %s stay powered"
            _logger.log(level, words, alone(driver.robot, driver.robot.names))
            if score is not None:
                _logger.info("%s", score)
        self._power(reading)
        self._commanded, self._pause = driver.clock.now(), 0.0
        return reading

    def _power(self, reading: Reading) -> None:
        """Switch torque on where the robot is."""
        self.last = reading.position.copy()
        self._sent.clear()
        self._sent.append((self.driver.clock.now(), reading.count.copy()))
        self.armed, self._slack = True, False
        if not self.dry_run:
            self.driver.torque_on(reading.count)
        self._watch.settle()

    def _stop_after(self, error: HardwareError) -> None:
        """Stop the robot after an error, and raise what keeps torque from going off."""
        try:
            self.stop()
        except ServoError as still:
            raise ServoError(f"{error}; {still}") from error

    def command(self, angles: np.ndarray) -> Sent:
        """Send requested angles [rad], (n,), within the limits, and return those sent.

        Raises:
            SafetyError: the robot is not armed, or an angle is not finite; the robot is stopped.
        """
        if not self.armed or self.last is None:
            raise SafetyError("the robot is not armed; call arm() first")
        wanted = np.asarray(angles, float)
        if wanted.shape != self.last.shape or not np.isfinite(wanted).all():
            self._stop_for(f"the command {wanted} is not {len(self.last)} finite angles")
        low, high = np.minimum(self.low, self.last), np.maximum(self.high, self.last)
        allowed = np.clip(wanted, low, high)
        sent = np.clip(allowed, self.last - self.max_step, self.last + self.max_step)
        limited = np.where(sent != allowed, "step", np.where(allowed != wanted, "limit", ""))
        if self._slack:
            raise SafetyError("the robot is limp; call stiffen() before the next command")
        self.last = exact = sent
        if not self.dry_run:
            sent = self._do(lambda: self.driver.command(exact))
            self._time_command()
            self._sent.append((self._commanded, self.driver.counts(sent)))
        return Sent(sent, tuple(limited.tolist()))

    def _time_command(self) -> None:
        now = self.driver.clock.now()
        if not math.isnan(self._commanded):
            self._pause = max(self._pause, now - self._commanded)
        self._commanded = now

    def read(self) -> Reading:
        """Read all servos, and the health of one in turn; stop if something is wrong.

        Raises:
            SafetyError: a check failed; the message names servo and reason. The robot is stopped.
        """
        reading = self.measure()
        self.inspect()
        return reading

    def measure(self) -> Reading:
        """Read all servos; stop if one is silent, reports an error or strays. A part of `read`.

        Raises:
            SafetyError: a check failed; the message names servo and reason. The robot is stopped.
        """
        reading = self._do(self.driver.read)
        if self.armed:
            follows = not (self.dry_run or self._slack)
            self._heed(self._watch.reading(reading, self.last if follows else None))
            if reading.alert.any():
                i = int(np.argmax(reading.alert))
                self._stop_for(self._watch.trouble(i, self._do(lambda: self.driver.health(i))))
        return reading

    def inspect(self) -> None:
        """Read the health of the next servo; stop if it is not healthy. A part of `read`.

        Raises:
            SafetyError: a check failed; the message names servo and reason. The robot is stopped.
        """
        if not self.armed:
            return
        i = self._turn = (self._turn + 1) % len(self.driver)
        health = self._do(lambda: self.driver.health(i))
        self._heed(self._watch.health(i, health))
        if health is None or self._slack:
            return
        if not self.dry_run:
            self._heed(self._watch.obedience(i, health, self._sent, self._longest_pause()))
        self._heed(self._watch.climate(i, health))

    def _heed(self, reason: str | None) -> None:
        """Stop the robot if there is a reason."""
        if reason is not None:
            self._stop_for(reason)

    def move_to(self, angles: np.ndarray, speed: float = 0.5) -> Reading:
        """Move to a pose [rad], (n,), at a speed [rad/s], and return the last reading.

        Raises:
            SafetyError: something went wrong during the motion; the robot is stopped.
        """
        rate = self.driver.robot.rate
        pace = FixedRate(self.driver.clock, rate)
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

    def release_torque(self) -> None:
        """Switch torque off for a swing; the robot remains armed and monitored.

        Raises:
            SafetyError: the robot is not armed, or a servo did not confirm.
        """
        if not self.armed:
            raise SafetyError("the robot is not armed; call arm() first")
        if not self.dry_run:
            self._switch(self.driver.torque_off)
        self._slack = True

    def restore_torque(self) -> Reading:
        """Switch torque on again at the current pose, which is held, and return its reading.

        Raises:
            SafetyError: a joint is outside its limits, or a servo does not follow.
        """
        try:
            reading = self._whole_reading()
            outside = self._outside(reading)
            if outside is not None:
                self._stop_for(f"{outside}: it swung there")
            self._power(reading)
        except (ServoError, SerialPortError) as error:
            self._stop_for(str(error))
        return reading

    def _switch(self, action: Callable[[], None]) -> None:
        try:
            self._do(action)
        except ServoError as error:
            self._stop_for(str(error))

    def stop(self) -> None:
        """Switch torque off and verify; can be called at any time and repeatedly.

        A lost bus is retried for `return_time`. Signals that arrive meanwhile end the program
        afterwards.

        Raises:
            ServoError: a servo did not confirm; it may still be powered: cut the supply.
        """
        if not self.armed or self.dry_run:
            self.armed = False
            return
        with self._ending.held():
            try:
                self._switch_off()
            except ServoError as error:
                self.armed = False
                _logger.critical("%s", error)
                raise
            self.armed = self._slack = False

    def _switch_off(self) -> None:
        """Switch torque off, on a bus that is gone as soon as it is back.

        Raises:
            ServoError: it did not come back, or a servo did not confirm.
        """
        driver, patience = self.driver, self.limits.return_time
        try:
            return driver.torque_off()
        except (SerialPortError, ServoError) as error:
            _logger.error("%s; trying for %g s to switch torque off", error, patience)
        try:
            driver.torque_off_after_reconnect(patience)
        except (SerialPortError, ServoError) as error:
            raise ServoError(
                f"torque could not be switched off within {patience:g} s ({error}); "
                f"{alone(driver.robot, driver.powered)} may still be powered: cut the supply"
            ) from error

    def _whole_reading(self) -> Reading:
        """Read until every servo has given a new answer."""
        for _ in range(ASKED):
            reading = self.driver.read()
            if reading.fresh.all():
                return reading
            self.driver.clock.sleep_until(self.driver.clock.now() + 0.01)
        silent = [
            n for n, new in zip(self.driver.robot.names, reading.fresh, strict=True) if not new
        ]
        raise SafetyError(f"no answers from {format_names(silent)}")

    def _state(self, i: int) -> Health:
        """Ask a servo for its state until it tells."""
        for _ in range(ASKED):
            health = self.driver.health(i)
            if health is not None:
                return health
        raise SafetyError(f"{self.driver.robot.names[i]} does not report its state")

    def _outside(self, reading: Reading) -> str | None:
        """Say which joint is too far outside its limits, or None."""
        edge = self.limits.outside
        for servo, q in zip(self.driver.robot.servos, reading.position.tolist(), strict=True):
            if not servo.position[0] - edge <= q <= servo.position[1] + edge:
                return (
                    f"{servo.name} is at {q:.3f} rad, outside its limits {list(servo.position)} "
                    f"by more than {edge:g}"
                )
        return None

    def _check_start(self, reading: Reading) -> None:
        outside = self._outside(reading)
        if outside is not None:
            raise SafetyError(f"{outside}; move it by hand, or calibrate")
        if reading.alert.any():
            i = int(np.argmax(reading.alert))
            health = self.driver.health(i)
            what, name = (
                format_names(health.errors) if health else "an error",
                self.driver.robot.names[i],
            )
            raise SafetyError(f"{name} reports {what}: find the reason, then reboot it")

    def _longest_pause(self) -> float:
        """The longest time without a command since arming, the present one included [s]."""
        since = self.driver.clock.now() - self._commanded
        return self._pause if math.isnan(since) else max(self._pause, since)

    def _do(self, action: Callable[[], Any]) -> Any:
        """Talk to the servos; if the bus is gone, switch off as soon as it is back."""
        try:
            return action()
        except SerialPortError as error:
            if not self.armed or self.dry_run:
                raise SafetyError(str(error)) from error
            try:
                self.stop()
            except ServoError as still:
                raise SafetyError(f"{error}; {still}") from error
            raise SafetyError(f"{error}; it came back, and torque is off") from error

    def abort(self, reason: str) -> NoReturn:
        """Stop the robot for an external reason, and raise a SafetyError that contains it."""
        self._stop_for(reason)

    def _stop_for(self, reason: str) -> NoReturn:
        """Stop the robot and raise a SafetyError with the reason."""
        _logger.error("stopped: %s", reason)
        try:
            self.stop()
        except ServoError as error:
            raise SafetyError(f"{reason}; and {error}") from error
        slow = self.driver.slow_link()
        link = "" if slow is None else f"; {slow}"
        raise SafetyError(f"{reason}; the robot was stopped, torque is off{link}")
