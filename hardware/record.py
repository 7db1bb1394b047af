"""Drive a robot along given angles and write down what it did, as a trajectory log.

    with Guard(driver) as guard:
        guard.arm()
        log = record(guard, excite(robot, pose, 10.0, ("ramp", "swing"), rng))
    write_log("swing.csv", log)

The guard's limits and stops hold while it is driven. `Recording` keeps the rows of a motion that
the guard, Ctrl-C or anything else ends early.
"""

import logging
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from hardware.body import OF_THE_IMU, BodySensors
from hardware.body import columns as list_columns
from hardware.config import Robot, Servo
from hardware.driver import Reading
from hardware.errors import HardwareError, LogError, SerialPortError, format_reason
from hardware.excite import ExcitationPlan
from hardware.link import LinkMonitor
from hardware.log import Log
from hardware.log_writer import LogWriter
from hardware.pace import FixedRate
from hardware.ranges import check_ranges
from hardware.safety import Guard

Row = dict[str, float]
_logger = logging.getLogger(__name__)


def joint_names(robot: Robot) -> list[str]:
    """Return the joint that each servo turns, in the order of the robot's file.

    Raises:
        RobotError: limits that lead far out of a joint's range.
    """
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    check_ranges(robot, model)
    joints = [model.actuator(name).trnid[0] for name in robot.names]
    return [model.joint(int(joint)).name for joint in joints]


def describe(robot: Robot) -> dict[str, Any]:
    """Return a log's metadata of its robot: settings, and its ports, or that it is emulated."""
    ports = [bus.port for bus in robot.buses] or robot.port
    return {
        "robot": robot.name,
        "model": str(robot.model.resolve()),
        "settings": {servo.name: robot.registers_of(servo) for servo in robot.servos},
        "rate": robot.rate,
        "command_delay": robot.command_delay,
        "supply_voltage": robot.supply.voltage,
        **({"emulated": True} if robot.port is None else {"port": ports}),
    }


def effort_column(servo: Servo) -> str:
    """Return the column of a servo's current [A], or its load if it measures no current."""
    return f"sensor.load_{servo.name}" if servo.type.current is None else f"current.{servo.name}"


class Recording:
    """One episode of a robot that is driven along a plan, row by row.

        recording = Recording(guard)
        try:
            recording.drive(plan)
        finally:
            log = recording.log()       # also what there is when something ended it early

    Args:
        guard: armed servos.
        episode: its number.
        sensors: sensors other than the servos, of which an IMU is logged; None for none.
        path: the CSV file that gets each row as it comes, see `LogWriter`; None writes none.
    """

    def __init__(
        self,
        guard: Guard,
        episode: int = 0,
        sensors: BodySensors | None = None,
        path: Path | None = None,
    ) -> None:
        self._guard, self._episode, self._sensors = guard, episode, sensors
        self._rows: list[Row] = []
        self._start: float | None = None
        self._joints = joint_names(guard.driver.robot)
        self.link: LinkMonitor | None = None  # from where the plan begins
        self.stopped: str | None = None  # why the plan was not driven to its end
        self._writer = None if path is None else LogWriter(path, self._meta())

    def __len__(self) -> int:
        return len(self._rows)

    def drive(self, plan: ExcitationPlan | np.ndarray) -> None:
        """Command a plan, one row per control step.

        Torque goes off and on at the time of the row that says so; switching can cost a step or
        two. While it is off, `ctrl` is where the joints are.

        Args:
            plan: wanted angles [rad], (T, n), and where torque is on; what was sent after every
                limit is `ctrl`.

        Raises:
            SafetyError: the robot was stopped on the way; the rows until then are kept.
        """
        if not isinstance(plan, ExcitationPlan):
            plan = ExcitationPlan(np.asarray(plan, float), np.ones(len(plan), bool))
        steps = zip(plan.angles, plan.torque.tolist(), strict=True)
        self._run(len(plan.angles), steps)

    def follow(self, wanted: Callable[[], np.ndarray], steps: int) -> None:
        """Command angles that are asked for at each step, such as a leader's; rows as `drive`.

        Args:
            wanted: returns the wanted angles [rad], (n,).
            steps: how many.

        Raises:
            SafetyError: the robot was stopped on the way, also because `wanted` had no answer.
        """

        def ask() -> tuple[np.ndarray, bool]:
            try:
                return wanted(), True
            except HardwareError as error:
                self._guard.abort(str(error))

        self._run(steps, iter(ask, None))

    def _run(self, count: int, steps: Iterator[tuple[np.ndarray, bool]]) -> None:
        """Take a number of steps, each requested at its time."""
        driver, on = self._guard.driver, True
        pace = FixedRate(driver.clock, driver.robot.rate)
        self.link = link = LinkMonitor(pace, driver.counters, driver.score)
        try:
            for _ in range(count):
                pace.wait()
                wanted, torque = next(steps)
                self._step(wanted, torque, on)
                on = torque
                if link.is_due(driver.clock.now()):
                    _logger.info("%s", link.statistics())
        except BaseException as error:
            self.stopped = format_reason(error)
            raise

    def _step(self, wanted: np.ndarray, torque: bool, on: bool) -> None:
        """Measure, switch torque where the plan says so, command, and keep the row."""
        guard = self._guard
        reading = guard.read()
        now = guard.driver.clock.now()
        body = self._sense(now)
        self._start = now if self._start is None else self._start
        if torque != on:
            guard.restore_torque() if torque else guard.release_torque()
        sent = guard.command(wanted).angles if torque else reading.position
        driven = torque and not guard.dry_run
        row = self._row(now - self._start, wanted, sent, reading, driven, body)
        self._rows.append(row)
        if self._writer is not None:
            self._writer.catch_up(self._rows)

    def _row(
        self,
        time: float,
        wanted: np.ndarray,
        sent: np.ndarray,
        reading: Reading,
        driven: bool,
        body: Mapping[str, np.ndarray],
    ) -> Row:
        """Return the columns of a control step, its time [s] from the first row's."""
        robot, row = self._guard.driver.robot, {"episode": float(self._episode), "time": time}
        pairs, start = list(zip(robot.names, self._joints, strict=True)), self._start or 0.0
        row |= {f"ctrl.{name}": float(sent[i]) for i, name in enumerate(robot.names)}
        for kind, values in (("qpos", reading.position), ("qvel", reading.velocity)):
            row |= {f"{kind}.{joint}": float(values[i]) for i, joint in enumerate(self._joints)}
        for i, (name, joint) in enumerate(pairs):
            row[f"stamp.{joint}"] = float(reading.stamp[i]) - start
            row[effort_column(robot.servos[i])] = float(reading.effort[i])
            if (health := self._guard.health[i]) is not None:
                row[f"voltage.{name}"] = health.voltage
                row[f"temperature.{name}"] = health.temperature
            row[f"torque.{name}"] = float(driven)
            row[f"sensor.duty_{name}"] = float(reading.duty[i])
            row[f"sensor.count_{name}"] = float(reading.count[i])
            row[f"action.{name}"] = float(wanted[i])
        site = None if robot.imu is None else robot.imu.site
        for name, values in body.items():
            row |= zip(list_columns(name, len(values), site), map(float, values), strict=True)
        return row | {"flag.fresh": float(reading.fresh.all())}

    def _sense(self, now: float) -> Mapping[str, np.ndarray]:
        """Return the IMU's readings; stop the robot if there are none."""
        if self._sensors is None:
            return {}
        try:
            values = self._sensors.measure(now)
        except SerialPortError as error:
            self._guard.abort(str(error))
        return {name: value for name, value in values.items() if name in OF_THE_IMU}

    def log(self) -> Log:
        """Return the recording so far.

        Returns:
            A log with ctrl, qpos, qvel, current (`sensor.load_<servo>` [of full load] of servos
            that measure none), stamp and torque of every servo, voltage and temperature as last
            read (one servo a step), the requested angles as `action`,
            the duty as `sensor.duty_<servo>`, the raw position as `sensor.count_<servo>`, and
            `flag.fresh` (0: an answer was missing, the last value is held), and the IMU's columns
            where there is one. Its metadata say
            `stopped` and why, if the plan was not driven to its end.

        Raises:
            LogError: there are fewer than two rows.
        """
        rows = self._rows
        if len(rows) < 2:
            name = self._guard.driver.robot.name
            raise LogError(f"{name}: {len(rows)} rows were recorded, but a log has at least 2")
        columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        return Log(columns, self._meta())

    def close(self) -> bool:
        """Give the file its name, and say whether there is one; does nothing the second time."""
        if self._writer is None:
            return False
        self._writer.catch_up(self._rows)
        return self._writer.close(self._meta())

    def _meta(self) -> dict[str, Any]:
        meta = describe(self._guard.driver.robot)
        if self.link is not None:
            meta["link"] = self.link.statistics().as_dict()
        return meta if self.stopped is None else meta | {"stopped": self.stopped}


def record(guard: Guard, plan: ExcitationPlan | np.ndarray, episode: int = 0) -> Log:
    """Drive a whole plan and return its log; see `Recording`.

    Raises:
        SafetyError: the robot was stopped on the way.
        LogError: the plan has fewer than two rows.
    """
    recording = Recording(guard, episode)
    recording.drive(plan)
    return recording.log()
