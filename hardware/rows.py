"""One robot as a row of episodes: the same task that was simulated, over what servos measure.

    rows = RobotRows(Quad8(), ServoBackend(load_robot("quad8"), settle=0.5))
    observation = rows.reset(np.arange(1), np.zeros((1, 0)), seeds)      # arms an emulated robot
    step = rows.step(None, action)
    rows.close()

It has the members of `envs.rows.Rows` with one row, so whatever runs simulations runs it, and needs
no torch. A task is any object with `initial`, `state_from_measurement`, `observe`, `command`,
`reward` and `terminated`, as `envs.tasks.servo.ServoTask` has them.

An episode ends as in simulation, and, with `failed` set, when the guard stops the robot; `stopped`
then says why, and the next reset raises until `arm` was called.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hardware.backends import Backend, RobotMeasurement, ServoBackend
from hardware.body import SIZES
from hardware.episode_log import EpisodeLog
from hardware.errors import (
    RobotError,
    SafetyError,
    ServoError,
    did_you_mean,
    format_names,
    format_reason,
)
from hardware.link import LinkStatistics
from hardware.safety import Sent


class Step(NamedTuple):
    """The result of one control step; the fields of `envs.rows.Step`, one row each."""

    observation: np.ndarray  # (1, O)
    reward: np.ndarray  # (1,)
    terminated: np.ndarray  # (1,) bool
    truncated: np.ndarray  # (1,) bool
    failed: np.ndarray  # (1,) bool: the robot was stopped


class Commanded(NamedTuple):
    """The robot's last action.

    The fields of `envs.tasks.base.CommandState`, one row each.
    """

    time: np.ndarray  # (1,) s
    action: np.ndarray  # (1, A)
    goal: np.ndarray  # (1, n) rad, as sent


class ActionRecord(NamedTuple):
    """The outcome of the last action; n servos in the task's order."""

    goal: np.ndarray  # rad, (n,): what the task made of the action, within its own limits
    applied: np.ndarray  # rad, (n,): what was sent after every limit
    limited: np.ndarray  # (n,) bool: where they differ by a limit of the guard's
    fresh: np.ndarray  # (n,) bool: servos with a new answer
    age: float  # s from asking the servos to writing the command
    missed: int  # deadlines missed in this step


class RobotRows:
    """Episodes of a task on one robot.

    Args:
        task: the task, of this robot.
        backend: the robot.
        folder: where each episode's log goes; None writes none.

    Raises:
        RobotError: the task is another robot's, runs at another rate, or needs a sensor that there
            is not.
    """

    num_rows = 1

    def __init__(self, task: Any, backend: Backend, folder: Path | None = None) -> None:
        self.task, self.backend = task, backend
        model = task.spec().compile()
        self.names = [model.actuator(i).name for i in range(model.nu)]
        _check_robot(task, self.names, backend)
        robot = backend.robot
        self._from_robot = np.array([robot.names.index(name) for name in self.names])
        self._to_robot = np.array([self.names.index(name) for name in robot.names])
        self.action_low, self.action_high = task.action_range(model)  # (A,)
        self.action_size, self.max_steps = len(self.action_low), task.max_steps
        self.log = EpisodeLog(robot, folder, driven=not getattr(backend, "dry_run", False))
        self.stopped: str | None = None
        self.over = True  # no episode is going on
        self.link: LinkStatistics | None = None  # of all episodes that have ended
        self.facts: dict[str, Any] = {}  # further metadata of the logs, such as "policy"
        self._rest: np.ndarray = np.asarray(task.rest(model))[None]  # (1, n)
        self._measured: RobotMeasurement | None = None
        blank = Commanded(np.zeros(1), np.zeros((1, self.action_size)), self._rest)
        self._state = task.state_from_measurement(self._rest, np.zeros_like(self._rest), blank)
        self.observation_size = task.observe(self._state).shape[1]
        self._last = np.zeros((1, self.observation_size))
        self.note = self._blank_note()
        _check_sensors(self, self.needs())

    def needs(self) -> tuple[set[str], set[str]]:
        """Return the sensors, other than the servos, that the observation and the reward use."""
        seen, paid = set(), set()
        turned = np.array([[0.96, 0.16, 0.16, 0.16]])
        odd = {"gyro": np.full((1, 3), 0.3), "position": np.full((1, 3), 0.3)}
        odd["orientation"] = turned / np.linalg.norm(turned)
        plain, zero, command = self._state, np.zeros_like(self._rest), self._state.command
        action = np.zeros((1, self.action_size))

        def reward(state: Any) -> np.ndarray:
            return self.task.reward(plain, state, action, np.zeros(1, bool))

        for name, value in odd.items():
            other = self.task.state_from_measurement(self._rest, zero, command, **{name: value})
            if not np.array_equal(self.task.observe(other), self.task.observe(plain)):
                seen.add(name)
            elif not np.array_equal(reward(other), reward(plain)):
                paid.add(name)
        return seen, paid

    def arm(self) -> None:
        """Let the robot move from now on; for a real one, clear the space around it before.

        Raises:
            HardwareError: a robot that is not as its file says, or cannot be armed.
        """
        self.backend.arm()
        self.stopped = None

    def reset(self, ids: np.ndarray, values: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        """Go to the start and begin an episode; see `envs.rows.Rows`. No ids do nothing.

        Raises:
            SafetyError: a real robot that was not armed, or one that was stopped before.
        """
        if not len(ids):
            return np.zeros((0, self.observation_size))
        self.finish()
        pose = self._held(seeds)
        measured = self.backend.start(pose[self._to_robot])
        goal = np.clip(pose, self.task.machine.low, self.task.machine.high)[None]
        self._take(measured, np.zeros((1, self.action_size)), goal)
        self.log.begin(measured, self._facts())
        self.note, self.over = self._blank_note(goal[0]), False
        self._last = self.task.observe(self._state)
        return self._last.copy()

    def _held(self, seeds: np.ndarray) -> np.ndarray:
        """Return the goals [rad], (n,), under which the robot comes to rest where episodes start.

        Soft servos sag: the goals are those of the simulation's own start, off by the same noise.
        """
        task = self.task
        start = task.initial(np.asarray(seeds, np.uint64))[0][0]
        return self._rest[0] + (start - task.start)[task.q]

    def step(self, ids: np.ndarray | None, action: np.ndarray) -> Step:
        """Send what the task makes of an action (1, A), and measure at the next deadline.

        Raises:
            SafetyError: no episode is going on.
        """
        if self.over or self._measured is None:
            raise SafetyError(f"{self.backend.robot.name}: no episode is in progress; call reset()")
        if ids is not None and not len(ids):
            return _nothing(self.observation_size)
        action = np.asarray(action, float).reshape(1, self.action_size)
        before, started = self._state, self._measured
        goal = self.task.command(before, action)  # (1, n)
        try:
            sent = self._command(action[0], goal[0])
            measured = self.backend.wait()
        except (SafetyError, ServoError) as error:
            return self._stop(str(error))
        applied = sent.angles[self._from_robot][None]
        self._take(measured, action, applied)
        with np.errstate(invalid="ignore", over="ignore"):
            terminated = self.task.terminated(self._state)
            reward = self.task.reward(before, self._state, action, terminated)
        self._last = self.task.observe(self._state)
        missed = measured.step - started.step - 1
        self.log.outcome(float(reward[0]), missed > 0)
        self.log.follow(measured)
        fresh = measured.reading.fresh[self._from_robot]
        self.note = self.note._replace(fresh=fresh, missed=missed)
        truncated = np.array([measured.step >= self.max_steps or measured.last])
        if terminated[0] or truncated[0]:
            self.finish()
        return Step(self._last.copy(), reward, terminated, truncated, np.zeros(1, bool))

    def _command(self, action: np.ndarray, goal: np.ndarray) -> Sent:
        """Send goals (n,) in the task's order and write them down."""
        backend, started = self.backend, self._measured
        assert started is not None
        sent = backend.command(goal[self._to_robot])
        time, health, counters = started.time, [], {}
        if isinstance(backend, ServoBackend):
            time, health, counters = backend.written, backend.health, backend.counters
        seen = self._last[0]
        self.log.add(time, action, goal[self._to_robot], sent, health, counters, seen)
        limited = np.array([bool(why) for why in sent.limited])[self._from_robot]
        applied = sent.angles[self._from_robot]
        self.note = ActionRecord(goal, applied, limited, self.note.fresh, time - started.time, 0)
        return sent

    def _take(self, measured: RobotMeasurement, action: np.ndarray, goal: np.ndarray) -> None:
        """Make the task's state of a measurement, the last action (1, A) and goals (1, n)."""
        order, reading = self._from_robot, measured.reading
        body = {
            name: np.asarray(value, float)[None]
            for name, value in measured.body.items()
            if name in SIZES
        }
        self._measured = measured
        self._state = self.task.state_from_measurement(
            reading.position[order][None],
            reading.velocity[order][None],
            Commanded(np.array([measured.step * self.task.dt]), action, goal),
            torque=measured.torque[order][None],
            **body,
        )

    def _stop(self, reason: str) -> Step:
        self.stopped = reason
        self.log.stopped()
        self.finish()
        yes, no = np.ones(1, bool), np.zeros(1, bool)
        return Step(self._last.copy(), np.zeros(1), yes, no, yes)

    def _facts(self) -> dict[str, Any]:
        """Return a log's metadata of the task and of the source of its commands."""
        return {"task": type(self.task).__name__, **self.facts}

    def finish(self) -> None:
        """End the present episode, and write its log."""
        self.over = True
        facts = self._facts()
        backend = self.backend
        if isinstance(backend, ServoBackend) and self._measured is not None:
            facts["counters"] = {name: c.as_dict() for name, c in backend.counters.items()}
            facts |= {"missed": backend.missed, "jitter": _spread(backend.pace.jitter)}
            facts["stopped"] = self.stopped
            facts["link"] = self._add_link(backend).as_dict()
        self.log.finish(facts)
        self._measured = None

    def _add_link(self, backend: ServoBackend) -> LinkStatistics:
        """Return the statistics of an episode that ends, and add them to those of all before."""
        assert backend.link is not None
        found = backend.link.statistics()
        self.link = found if self.link is None else self.link + found
        return found

    def close(self) -> None:
        """Write the log, park, switch torque off, let go.

        The log of an episode that an exception ended, such as Ctrl-C or the policy's, says so.

        Raises:
            HardwareError: parking failed, or a servo did not confirm that it is off.
        """
        error = sys.exc_info()[1]
        try:
            if error is not None and not self.over:
                self._stop(format_reason(error))
            self.finish()
        finally:
            self.backend.close()

    def _blank_note(self, goal: np.ndarray | None = None) -> ActionRecord:
        held = self._rest[0] if goal is None else goal
        n = len(held)
        return ActionRecord(held.copy(), held.copy(), np.zeros(n, bool), np.ones(n, bool), 0.0, 0)


def _nothing(observation_size: int) -> Step:
    none = np.zeros(0, bool)
    return Step(np.zeros((0, observation_size)), np.zeros(0), none, none, none)


def _spread(jitter: Sequence[float]) -> dict[str, float]:
    """Return median, 99th percentile and largest [s]."""
    if not len(jitter):
        return {}
    p50, p99 = np.percentile(jitter, [50, 99])
    return {"p50": float(p50), "p99": float(p99), "max": float(max(jitter))}


def _check_robot(task: Any, names: list[str], backend: Backend) -> None:
    robot, machine = backend.robot, task.machine
    if robot.name != machine.name or sorted(names) != sorted(robot.names):
        hint = did_you_mean(machine.name, [robot.name])
        raise RobotError(
            f"{type(task).__name__} is a task of the robot {machine.name!r} with the servos "
            f"{format_names(names)}, but this robot is {robot.name!r} with "
            f"{format_names(robot.names)}{hint}; give "
            f"robot={machine.name}, or a policy that was trained for {robot.name}"
        )
    if abs(robot.rate - machine.rate) > 1e-9:
        raise RobotError(
            f"{robot.name}: rate {robot.rate:g}, but the task runs {machine.rate:g} steps per "
            f"second; give robot.rate={machine.rate:g}, or train at {robot.rate:g}"
        )


def _check_sensors(rows: RobotRows, needs: tuple[set[str], set[str]]) -> None:
    lacking = sorted(needs[0] - set(rows.backend.sensor_names))
    if lacking:
        raise RobotError(
            f"{type(rows.task).__name__} observes {format_names(lacking)}, but "
            f"{rows.backend.robot.name} has no such sensor; give imu_port= if its file names an "
            "IMU that measures it, or ServoBackend(sensors=...), see hardware/body.py"
        )
