"""A recorded log in place of a robot: the same measurements again, whatever is commanded.

    backend = LogBackend(read_log("logs/episode-0003.csv"), load_robot("quad8"))
    rows = RobotRows(Quad8(), backend)

What the log says was sent is returned as sent. Each `start` takes the next episode.
"""

from __future__ import annotations

import numpy as np

from hardware.backends import RobotMeasurement
from hardware.body import SIZES, columns
from hardware.config import Robot
from hardware.driver import Reading
from hardware.errors import LogError
from hardware.log import Log, check_names
from hardware.record import joint_names
from hardware.safety import Sent


class LogBackend:
    """Plays the episodes of a log.

    Args:
        log: a log as an episode on a robot writes it.
        robot: whose log it is.

    Raises:
        LogError: the log is another robot's.
    """

    real = False

    def __init__(self, log: Log, robot: Robot) -> None:
        self.robot, self._log = robot, log
        self._joints = joint_names(robot)
        check_names(log, self._joints, robot.names, self._joints)
        missing = [name for name in robot.names if name not in log.actuators]
        if missing:
            raise LogError(f"{log.path or 'the log'}: the column 'ctrl.{missing[0]}' is missing")
        self._episodes = iter(list(log.episodes()))
        self._episode, self._row = log, 0
        self._constant = np.array([servo.type.torque_constant for servo in robot.servos])

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """The sensors beside the servos that the log has."""
        return tuple(name for name in SIZES if self._columns(name))

    def _columns(self, name: str) -> list[str]:
        """Return the log's columns for a quantity; none if it lacks one."""
        sites = [None] if self.robot.imu is None else [self.robot.imu.site, None]
        for site in sites:  # logs without the site's columns have those of a sensor
            found = columns(name, SIZES[name], site)
            if all(column in self._log.columns for column in found):
                return found
        return []

    def open(self) -> None:
        """Do nothing: there is nothing to open."""

    def arm(self) -> None:
        """Do nothing: there is nothing to arm."""

    def close(self) -> None:
        """Do nothing."""

    def start(self, pose: np.ndarray) -> RobotMeasurement:
        """Take the next episode and return its first row.

        Raises:
            LogError: there is none left.
        """
        episode = next(self._episodes, None)
        if episode is None:
            raise LogError(f"{self._log.path or 'the log'}: all its episodes have been replayed")
        self._episode, self._row = episode, 0
        return self._measured()

    def command(self, goals: np.ndarray) -> Sent:
        """Return what was sent at this row of the log."""
        return Sent(self._row_of("ctrl", self.robot.names), ("",) * len(self.robot.names))

    def wait(self) -> RobotMeasurement:
        """Go on to the next row."""
        self._row += 1
        return self._measured()

    def _measured(self) -> RobotMeasurement:
        names, joints = self.robot.names, self._joints
        time = float(self._episode.time[self._row])
        n = len(names)
        current = self._row_of("current", names)
        reading = Reading(
            time=time,
            position=self._row_of("qpos", joints),
            velocity=self._row_of("qvel", joints),
            current=current,
            effort=current,
            duty=self._row_of("sensor", [f"duty_{name}" for name in names]),
            stamp=self._row_of("stamp", joints),
            count=self._row_of("sensor", [f"count_{name}" for name in names]).astype(np.int64),
            fresh=self._row_of("sensor", [f"fresh_{name}" for name in names], 1.0).astype(bool),
            alert=np.zeros(n, bool),
        )
        torque = self._row_of("sensor", [f"torque_{name}" for name in names], np.nan)
        torque = np.where(np.isnan(torque), self._constant * current, torque)
        values = self._episode.columns
        body = {
            name: np.array([values[column][self._row] for column in self._columns(name)])
            for name in self.sensor_names
        }
        step = int(time * self.robot.rate + 1e-6)
        last = self._row == len(self._episode) - 1
        return RobotMeasurement(step, time, reading, torque, body, last)

    def _row_of(self, kind: str, names: list[str], missing: float = 0.0) -> np.ndarray:
        """Return one number for each name, (n,), from the present row."""
        columns = self._episode.columns
        values = [columns.get(f"{kind}.{name}") for name in names]
        return np.array([missing if v is None else v[self._row] for v in values])
