"""The log of an episode on a robot, one row per control step: measured, requested and sent.

    log = EpisodeLog(robot, folder=Path("logs"))
    log.begin(measured)                                         # logs/episode-0000.csv.part
    log.add(time, action, wanted, sent, health, counters)       # as the command is written
    log.outcome(reward, late)                                   # what came of it
    log.follow(measured)                                        # the next row's measurement
    log.finish({"missed": 0})                                   # logs/episode-0000.csv

Beside the columns of every log there are `obs.<i>` and `action.<i>` (what the policy saw and said,
cut at the task's limits as in training), `action.<servo>` (the goal that the task made of it,
within the robot's limits) where `ctrl.<servo>` is what was sent; `sensor.count_`, `duty_`, `load_`,
`torque_`, `fresh_` and `lost_<servo>` (raw position, duty, load where no current is measured, N·m,
whether the answer is new, answers lost or stale so far), those of the IMU if the robot's file says
its site, `sensor.<name>_<i>` of another sensor, `flag.late` (a deadline was missed in this step),
`flag.limited` (the guard sent less than the goal; what the task itself cut is not flagged),
`flag.stopped` and `flag.end` (the episode's last measurement: nothing was sent any more, the last
command holds).
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hardware.backends import RobotMeasurement
from hardware.body import columns
from hardware.config import Robot
from hardware.counters import Counters
from hardware.driver import Health
from hardware.log import Log
from hardware.log_writer import LogWriter
from hardware.record import describe, effort_column, joint_names
from hardware.safety import Sent

Row = dict[str, float]


class EpisodeLog:
    """Gathers the rows of one episode after the other, and writes a file for each.

    Args:
        robot: whose log it is.
        folder: where the files go; those there are numbered on from. None writes none.
        driven: whether commands reach the servos; else the log says that their torque is off.
    """

    def __init__(self, robot: Robot, folder: Path | None = None, driven: bool = True) -> None:
        self.robot, self.folder, self.driven = robot, folder, driven
        self.last: Log | None = None  # of the episode that ended last
        self._joints = joint_names(robot)
        self._number = 0 if folder is None else _next_number(folder)
        self._rows: list[Row] = []
        self._measured: RobotMeasurement | None = None
        self._writer: LogWriter | None = None

    def begin(self, measured: RobotMeasurement, facts: Mapping[str, Any] | None = None) -> None:
        """Start an episode with what was measured first.

        Args:
            measured: the first measurement.
            facts: metadata in addition to the robot's settings, as far as is known.
        """
        self._rows, self._measured = [], measured
        if self.folder is not None:
            path = self.folder / f"episode-{self._number:04d}.csv"
            self._writer = LogWriter(path, self._meta(facts or {}))

    def add(
        self,
        time: float,
        action: np.ndarray,
        wanted: np.ndarray,
        sent: Sent,
        health: Sequence[Health | None],
        counters: Mapping[str, Counters],
        observation: Sequence[float] | np.ndarray = (),
    ) -> None:
        """Write a command and the measurement before it.

        Args:
            time: when it was written, from the episode's start [s].
            action: what the policy said, (A,).
            wanted: the goals asked for [rad], (n,).
            sent: the goals sent.
            health: the newest state of each servo; empty where there is none.
            counters: of each servo.
            observation: what the policy saw, (O,).
        """
        assert self._measured is not None
        if self._writer is not None:
            self._writer.catch_up(self._rows)
        place = {"episode": float(self._number), "time": time}
        row = place | self._measurement(self._measured)
        names = self.robot.names
        for i, name in enumerate(names):
            row[f"ctrl.{name}"], row[f"action.{name}"] = float(sent.angles[i]), float(wanted[i])
        if not self.driven:
            row |= dict.fromkeys((f"torque.{name}" for name in names), 0.0)
        row |= {f"action.{i}": float(value) for i, value in enumerate(action)}
        row |= {f"obs.{i}": float(value) for i, value in enumerate(observation)}
        row["flag.limited"] = float(any(sent.limited))
        for name, state in zip(names, health, strict=False):
            if state is not None:
                row[f"voltage.{name}"], row[f"temperature.{name}"] = (
                    state.voltage,
                    state.temperature,
                )
        for name, count in counters.items():
            row[f"sensor.lost_{name}"] = float(count.lost + count.stale)
        flags = dict.fromkeys(("flag.late", "flag.stopped", "flag.end"), 0.0)
        self._rows.append(row | {"reward": 0.0} | flags)

    def outcome(self, reward: float, late: bool) -> None:
        """Write down what the last command earned, and whether its step missed a deadline."""
        self._rows[-1] |= {"reward": reward, "flag.late": float(late)}

    def stopped(self) -> None:
        """Mark the last command as the one after which the robot was stopped."""
        if self._rows:
            self._rows[-1]["flag.stopped"] = 1.0

    def follow(self, measured: RobotMeasurement) -> None:
        """Take the measurement that the next row starts with."""
        self._measured = measured

    def finish(self, facts: Mapping[str, Any]) -> Log | None:
        """End the episode and write its file; None if it has no rows.

        Args:
            facts: metadata in addition to the robot's settings.
        """
        rows, measured, meta, log = self._rows, self._measured, self._meta(facts), None
        if rows and measured is not None and measured.time > rows[-1]["time"]:
            end = {"reward": 0.0, "flag.late": 0.0, "flag.end": 1.0, "time": measured.time}
            rows.append(rows[-1] | end | self._measurement(measured))
        if self._writer is not None:
            self._writer.catch_up(rows)
            self._writer.close(meta)
        if len(rows) >= 2:
            log = Log({name: np.array([row[name] for row in rows]) for name in rows[0]}, meta)
            self.last = log
            self._number += 1
        self._rows, self._measured, self._writer = [], None, None
        return log

    def _measurement(self, measured: RobotMeasurement) -> Row:
        reading, row = measured.reading, {}
        begin = reading.time - measured.time
        for i, (name, joint) in enumerate(zip(self.robot.names, self._joints, strict=True)):
            row |= {
                f"qpos.{joint}": float(reading.position[i]),
                f"qvel.{joint}": float(reading.velocity[i]),
                f"stamp.{joint}": float(reading.stamp[i]) - begin,
                effort_column(self.robot.servos[i]): float(reading.effort[i]),
                f"sensor.duty_{name}": float(reading.duty[i]),
                f"sensor.count_{name}": float(reading.count[i]),
                f"sensor.torque_{name}": float(measured.torque[i]),
                f"sensor.fresh_{name}": float(reading.fresh[i]),
            }
        site = None if self.robot.imu is None else self.robot.imu.site
        for name, values in measured.body.items():
            row |= zip(columns(name, len(values), site), map(float, values), strict=True)
        return row | {"flag.fresh": float(reading.fresh.all())}

    def _meta(self, facts: Mapping[str, Any]) -> dict[str, Any]:
        return {**describe(self.robot), **facts}


def _next_number(folder: Path) -> int:
    names = [path.name for path in folder.glob("episode-*.csv*")]
    numbers = [int(name.split("-")[1].split(".")[0]) for name in names]
    return max(numbers, default=-1) + 1
