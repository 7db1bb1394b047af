"""Backends of an episode on a robot: servos at a port, the emulated robot, or a recorded log.

    backend = ServoBackend(load_robot("quad8"), settle=0.5)      # no port: the emulated robot
    backend.open()                                               # everything checked, torque off
    backend.arm()
    measured = backend.start(pose)                               # slowly to where episodes start
    while not measured.last:
        sent = backend.command(goals)                            # at once
        measured = backend.wait()                                # at the next deadline
    backend.close()                                              # parked, torque off, verified

Order and time of a step: a command is written as soon as it is known, then one servo is asked for
its health, then the deadline is waited for and everything is read. Deadlines are absolute; those
that are missed are counted and never made up for.
"""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from hardware.body import BodySensors, EmulatedBody
from hardware.clock import VirtualClock
from hardware.config import Robot
from hardware.connect import make_driver
from hardware.counters import Counters
from hardware.driver import Driver, Health, Reading
from hardware.emulator.world import EmulatedRobot
from hardware.errors import SafetyError, SerialPortError
from hardware.imu.reader import SerialImu, make_imu
from hardware.link import LinkMonitor
from hardware.pace import FixedRate
from hardware.safety import Guard, Sent, StopLimits

PATIENCE = 5.0  # s that a lost port is waited for


class RobotMeasurement(NamedTuple):
    """The readings of a robot of n servos at one deadline."""

    step: int  # deadlines since the episode's start, missed ones included
    time: float  # s from the episode's start to when the servos were asked
    reading: Reading
    torque: np.ndarray  # N·m, of the motors, (n,)
    body: Mapping[str, np.ndarray]  # of sensors other than the servos, see `hardware/body.py`
    last: bool = False  # nothing follows: the end of a recorded episode


class Backend(Protocol):
    """The interface of backends. Arrays are in the order of the servos."""

    robot: Robot
    real: bool  # true for a physical robot, which must be armed by a person next to it

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Return the names of the sensors other than the servos."""
        ...

    def open(self) -> None:
        """Connect and check everything; torque stays off."""
        ...

    def arm(self) -> None:
        """Switch torque on without a movement."""
        ...

    def start(self, pose: np.ndarray) -> RobotMeasurement:
        """Go to a pose [rad], (n,), begin an episode there, and return its first measurement."""
        ...

    def command(self, goals: np.ndarray) -> Sent:
        """Send goals [rad], (n,), and return what was sent."""
        ...

    def wait(self) -> RobotMeasurement:
        """Wait for the next deadline and measure."""
        ...

    def close(self) -> None:
        """Park, switch torque off, and let go; does nothing the second time."""
        ...


class ServoBackend:
    """Servos on a bus: real ones at the robot's port, else emulated ones in virtual time.

    Args:
        robot: the robot's file, calibration applied.
        settle: how long the pose of the start is held before an episode begins [s]: an emulated
            robot comes to rest, a real one is put back on its feet.
        world: the emulated robot; None makes one as the file says.
        dry_run: switch torque off, then read everything and compute commands, but send none.
        sensors: an IMU or a tracker, instead of the IMU at the port that the
            robot's file names; the emulated robot has its own.
        limits: when the guard stops the robot.
        seed: the seed of the emulated robot's randomness.
        clock: the clock of the emulated robot; None makes one.
    """

    def __init__(
        self,
        robot: Robot,
        settle: float,
        world: EmulatedRobot | None = None,
        dry_run: bool = False,
        sensors: BodySensors | None = None,
        limits: StopLimits | None = None,
        seed: int = 0,
        clock: VirtualClock | None = None,
    ) -> None:
        self.robot, self.real, self.dry_run = robot, robot.port is not None, dry_run
        self.world = world if self.real or world is not None else EmulatedRobot(robot, seed=seed)
        emulated = EmulatedBody(self.world) if self.world is not None and not self.real else None
        self.sensors = sensors or emulated or make_imu(robot)
        self.stopped: str | None = None  # why the guard stopped the robot
        self._limits, self._settle, self._clock = limits, settle, clock
        self._driver: Driver | None = None
        self._guard: Guard | None = None
        self._pace: FixedRate | None = None
        self._began = self._written = 0.0
        self.missed = self._step = 0  # deadlines of the present episode
        self.link: LinkMonitor | None = None  # of the present episode
        self._rest: np.ndarray | None = None
        self._constant = np.array([s.type.torque_constant for s in robot.servos])
        self._resistance = np.array([s.type.resistance for s in robot.servos])
        self._voltage = np.array([robot.supply_of(s).voltage for s in robot.servos])
        self._senses_current = np.array([s.type.current is not None for s in robot.servos])

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """The names of the sensors other than the servos."""
        return () if self.sensors is None else self.sensors.names

    @property
    def guard(self) -> Guard:
        """The hand that moves the robot; raises SafetyError before `open`."""
        if self._guard is None:
            raise SafetyError(f"{self.robot.name} is not open; call open()")
        return self._guard

    @property
    def pace(self) -> FixedRate:
        """The deadlines of the present episode."""
        if self._pace is None:
            raise SafetyError(f"{self.robot.name}: no episode has begun; call start()")
        return self._pace

    @property
    def counters(self) -> dict[str, Counters]:
        """The link counters of each servo."""
        return self.guard.driver.counters

    @property
    def health(self) -> list[Health | None]:
        """The newest state of each servo."""
        return list(self.guard.health)

    @property
    def written(self) -> float:
        """When the last command was written, from the episode's start [s]."""
        return self._written - self._began

    def open(self) -> None:
        """Connect, check and set up every servo; torque is off.

        Raises:
            SerialPortError: the port cannot be used.
            ServoError: a servo is not as the robot's file says.
        """
        if self._guard is not None:
            return
        driver = self.make_driver()
        try:
            if isinstance(self.sensors, SerialImu):
                self.sensors.open()
            driver.connect()
            if self.dry_run:
                driver.torque_off()
            else:
                driver.configure()
        except BaseException:
            self._let_go(driver)
            raise
        self._driver = driver
        self._guard = Guard(driver, self._limits, self.dry_run).__enter__()

    def make_driver(self) -> Driver:
        """Return the driver of the robot's buses; nothing is opened yet."""
        return make_driver(self.robot, self.world, self._clock)

    def arm(self) -> None:
        """Switch torque on at the robot's pose; the space around it must be clear.

        After a stop everything is connected, checked and set up again before: the cable may have
        been out, and a servo that rebooted has lost its settings.

        Raises:
            SerialPortError: the port did not come back.
            SafetyError: a servo is outside its limits, or reports an error.
            ServoError: a servo is not as the robot's file says.
        """
        self.open()
        driver = self.guard.driver
        if self.stopped is not None and self.dry_run:
            driver.connect()
        elif self.stopped is not None:
            driver.reconnect(PATIENCE)
        self.guard.arm()
        self.stopped = None
        self._written = self.guard.driver.clock.now()

    def start(self, pose: np.ndarray) -> RobotMeasurement:
        """Go slowly to a pose [rad], (n,), hold it, and begin an episode.

        Raises:
            SafetyError: a real robot that was not armed, or one that was stopped before.
        """
        guard = self._ready()
        try:
            return self._start(guard, pose)
        except SafetyError as error:
            self.stopped = str(error)
            raise

    def _start(self, guard: Guard, pose: np.ndarray) -> RobotMeasurement:
        guard.move_to(pose)
        self._rest = guard.last if self._rest is None else self._rest
        if self.sensors is not None:
            self.sensors.return_to_start(guard.driver.clock.now())
        pace = self._pace = FixedRate(guard.driver.clock, self.robot.rate)
        for _ in range(max(1, round(self._settle * self.robot.rate))):
            pace.wait()
            guard.read()
            self._sense(guard.driver.clock.now())  # a port that is not read runs over
            self._send(guard.last)
        pace.jitter.clear()
        self.missed = self._step = 0
        self.link = LinkMonitor(pace, self.counters, guard.driver.score)
        self._began = pace.wait()
        return self._measure(self._began)

    def _ready(self) -> Guard:
        """Return the armed guard; arm it again after a pause in which the watchdogs tripped."""
        name, armed = self.robot.name, self._guard is not None and self._guard.armed
        if self.stopped is not None:
            raise SafetyError(f"{name} was stopped: {self.stopped}; remove the cause, then arm()")
        if self.real and not armed:
            raise SafetyError(
                f"{name} at {self.robot.port} is not armed; clear the space around it, then arm()"
            )
        if not armed or self._late():
            self.arm()
        return self.guard

    def command(self, goals: np.ndarray) -> Sent:
        """Send goals [rad], (n,) within the guard's limits, then look at one servo's health.

        Raises:
            SafetyError: the robot was stopped, and why.
        """
        try:
            sent = self._send(goals)
            self.guard.inspect()
        except SafetyError as error:
            self.stopped = str(error)
            raise
        return sent

    def _send(self, goals: np.ndarray | None) -> Sent:
        assert goals is not None
        sent = self.guard.command(goals)
        self._written = self.guard.driver.clock.now()
        return sent

    def wait(self) -> RobotMeasurement:
        """Wait for the next deadline, then measure.

        Raises:
            SafetyError: the robot was stopped, and why.
        """
        try:
            # a command that came too late for a deadline gets its time to act before it is read
            return self._measure(self.pace.wait(latest=self.pace.period / 2))
        except SafetyError as error:
            self.stopped = str(error)
            raise

    def _measure(self, deadline: float) -> RobotMeasurement:
        reading = self.guard.measure()
        step = round((deadline - self._began) * self.robot.rate)
        self.missed += max(step - self._step - 1, 0)
        self._step = step
        now = self.guard.driver.clock.now()
        body = self._sense(now)
        return RobotMeasurement(
            step, reading.time - self._began, reading, self._torque(reading), body
        )

    def _sense(self, now: float) -> Mapping[str, np.ndarray]:
        """Return the readings of the sensors other than the servos; stop the robot if they fail."""
        if self.sensors is None:
            return {}
        try:
            return self.sensors.measure(now)
        except SerialPortError as error:
            self.guard.abort(str(error))

    def _torque(self, reading: Reading) -> np.ndarray:
        """Return the motors' torques [N·m], (n,), from current or, where there is none, from duty.

        K i, or K (V - K w) / R.
        """
        k = self._constant
        volts = reading.duty * self._voltage
        driven = k * (volts - k * reading.velocity) / self._resistance
        return np.where(self._senses_current, k * reading.current, driven)

    def park(self) -> None:
        """Go slowly to where the first episode started, then switch torque off and verify.

        Raises:
            SafetyError: something went wrong on the way; the robot is stopped.
            ServoError: a servo did not confirm that it is off.
        """
        guard = self.guard
        if guard.armed and self._rest is not None:
            if self._late():
                guard.arm()
            guard.move_to(self._rest)
        guard.stop()

    def _late(self) -> bool:
        """Say whether the servos' watchdogs may have tripped since the last command."""
        passed = self.guard.driver.clock.now() - self._written
        return not self.dry_run and 0 < self.robot.watchdog / 2 < passed

    def close(self) -> None:
        """Park, switch torque off, close the port.

        Raises:
            SafetyError: parking failed; torque is off.
            ServoError: a servo did not confirm that it is off: cut the supply.
        """
        guard, driver = self._guard, self._driver
        if guard is None or driver is None:
            return
        try:
            self.park()
        finally:
            self._guard = self._driver = None
            try:
                guard.__exit__(None, None, None)
            finally:
                self._let_go(driver)

    def _let_go(self, driver: Driver) -> None:
        """Close the ports of the servos and of the IMU."""
        driver.close()
        if isinstance(self.sensors, SerialImu):
            self.sensors.close()
