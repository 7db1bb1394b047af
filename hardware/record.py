"""Drive a robot along given angles and write down what it did, as a trajectory log.

    with Guard(driver) as guard:
        guard.arm()
        log = record(guard, excite(robot, pose, 10.0, ("ramp", "swing"), rng))
    write_log("swing.csv", log)

The guard's limits and stops hold while it is driven. `Recording` keeps the rows of a motion that
the guard, Ctrl-C or anything else ends early.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from hardware.body import OF_THE_IMU, BodySensors
from hardware.body import columns as list_columns
from hardware.config import Robot
from hardware.driver import Health, Reading
from hardware.errors import LineError, LogError
from hardware.excite import Plan
from hardware.log import Log
from hardware.pace import Pace
from hardware.safety import Guard


class _Row(NamedTuple):
    """One control step."""

    time: float  # s from the first row's
    wanted: np.ndarray  # rad, (n,)
    sent: np.ndarray  # rad, (n,)
    reading: Reading
    driven: bool
    health: list[Health | None]
    body: Mapping[str, np.ndarray]  # of the IMU


def joint_names(robot: Robot) -> list[str]:
    """Return the joint that each servo turns, in the order of the robot's file."""
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    joints = [model.actuator(name).trnid[0] for name in robot.names]
    return [model.joint(int(joint)).name for joint in joints]


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
        sensors: what is beside the servos, of which an IMU is written down; None for nothing.
    """

    def __init__(self, guard: Guard, episode: int = 0, sensors: BodySensors | None = None) -> None:
        self._guard, self._episode, self._sensors = guard, episode, sensors
        self._rows: list[_Row] = []
        self._start: float | None = None
        self.stopped: str | None = None  # why the plan was not driven to its end

    def __len__(self) -> int:
        return len(self._rows)

    def drive(self, plan: Plan | np.ndarray) -> None:
        """Command a plan, one row per control step.

        Torque goes off and on at the time of the row that says so; switching can cost a step or
        two. While it is off, `ctrl` is where the joints are.

        Args:
            plan: wanted angles [rad], (T, n), and where torque is on; what was sent after every
                limit is `ctrl`.

        Raises:
            SafetyError: the robot was stopped on the way; the rows until then are kept.
        """
        if not isinstance(plan, Plan):
            plan = Plan(np.asarray(plan, float), np.ones(len(plan), bool))
        pace, on = Pace(self._guard.driver.clock, self._guard.driver.robot.rate), True
        try:
            for wanted, torque in zip(plan.angles, plan.torque.tolist(), strict=True):
                pace.wait()
                self._step(wanted, torque, on)
                on = torque
        except BaseException as error:
            self.stopped = str(error) or type(error).__name__
            raise

    def _step(self, wanted: np.ndarray, torque: bool, on: bool) -> None:
        """Measure, switch torque where the plan says so, command, and keep the row."""
        guard = self._guard
        reading = guard.read()
        now = guard.driver.clock.now()
        body = self._sense(now)
        self._start = now if self._start is None else self._start
        if torque != on:
            guard.stiffen() if torque else guard.limp()
        sent = guard.command(wanted).angles if torque else reading.position
        driven = torque and not guard.dry_run
        row = _Row(now - self._start, wanted, sent, reading, driven, list(guard.health), body)
        self._rows.append(row)

    def _sense(self, now: float) -> Mapping[str, np.ndarray]:
        """Return what an IMU measures; stop the robot if it does not."""
        if self._sensors is None:
            return {}
        try:
            values = self._sensors.measure(now)
        except LineError as error:
            self._guard.give_up(str(error))
        return {name: value for name, value in values.items() if name in OF_THE_IMU}

    def log(self) -> Log:
        """Return what was recorded so far.

        Returns:
            A log with ctrl, qpos, qvel, current, stamp and torque of every servo, voltage and
            temperature as last told (one servo a step tells them), the wanted angles as `action`,
            the duty as `sensor.duty_<servo>`, the raw position as `sensor.count_<servo>`, and
            `flag.fresh` (0: an answer was missing, the last value is held), and the IMU's columns
            where there is one. Its metadata say
            `stopped` and why, if the plan was not driven to its end.

        Raises:
            LogError: there are fewer than two rows.
        """
        robot, rows = self._guard.driver.robot, self._rows
        if len(rows) < 2:
            raise LogError(f"{robot.name}: {len(rows)} rows were recorded, a log has at least 2")
        columns: dict[str, Any] = {
            "episode": np.full(len(rows), self._episode),
            "time": np.array([row.time for row in rows]),
        }
        pairs = list(zip(robot.names, joint_names(robot), strict=True))
        for i, (name, _) in enumerate(pairs):
            columns[f"ctrl.{name}"] = np.array([row.sent[i] for row in rows])
        for kind, field in (("qpos", "position"), ("qvel", "velocity")):
            for i, (_, joint) in enumerate(pairs):
                columns[f"{kind}.{joint}"] = np.array([getattr(r.reading, field)[i] for r in rows])
        for i, (name, joint) in enumerate(pairs):
            columns |= self._servo_columns(i, name, joint)
        site = None if robot.imu is None else robot.imu.site
        for name, first in rows[0].body.items():
            values = np.array([row.body[name] for row in rows])
            columns |= zip(list_columns(name, len(first), site), values.T, strict=True)
        columns["flag.fresh"] = np.array([float(row.reading.fresh.all()) for row in rows])
        return Log(columns, self._meta())

    def _servo_columns(self, i: int, name: str, joint: str) -> dict[str, np.ndarray]:
        rows, start = self._rows, self._start or 0.0
        readings = [row.reading for row in rows]
        columns = {
            f"stamp.{joint}": np.array([r.stamp[i] - start for r in readings]),
            f"current.{name}": np.array([r.current[i] for r in readings]),
        }
        told = [health for row in rows if (health := row.health[i]) is not None]
        if len(told) == len(rows):
            columns[f"voltage.{name}"] = np.array([health.voltage for health in told])
            columns[f"temperature.{name}"] = np.array([health.temperature for health in told])
        return columns | {
            f"torque.{name}": np.array([float(row.driven) for row in rows]),
            f"sensor.duty_{name}": np.array([r.duty[i] for r in readings]),
            f"sensor.count_{name}": np.array([r.count[i] for r in readings]),
            f"action.{name}": np.array([row.wanted[i] for row in rows]),
        }

    def _meta(self) -> dict[str, Any]:
        robot = self._guard.driver.robot
        settings = {servo.name: robot.registers_of(servo) for servo in robot.servos}
        meta = {
            "robot": robot.name,
            "model": str(robot.model.resolve()),
            "settings": settings,
            "rate": robot.rate,
            "command_delay": robot.command_delay,
            "supply_voltage": robot.supply.voltage,
        }
        return meta if self.stopped is None else meta | {"stopped": self.stopped}


def record(guard: Guard, plan: Plan | np.ndarray, episode: int = 0) -> Log:
    """Drive a whole plan and return its log; see `Recording`.

    Raises:
        SafetyError: the robot was stopped on the way.
        LogError: the plan has fewer than two rows.
    """
    recording = Recording(guard, episode)
    recording.drive(plan)
    return recording.log()
