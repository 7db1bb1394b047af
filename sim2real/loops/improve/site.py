"""A robot in a loop: how it is run and recorded, and what a policy's return on it is.

    site = RobotSetup(machine, environment, Operator(), trials=10, ...)
    site.deploy(trained, folder)                # returns on the robot, one an episode
    site.score(trained, environment)            # in a simulator, from the same starts

The emulated robot has a tracker. Where a real one has none and its task pays distance, the operator
enters the distance of each episode; returns are then distance [m] less the task's other costs, on
the robot and in simulation alike.
"""

import logging
import shutil
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from envs.randomization import Randomization
from envs.tasks.servo import ServoTask
from envs.unactuated import unobservable_joints_message
from hardware.backends import ServoBackend
from hardware.config import Robot
from hardware.excite import Kind
from hardware.log import Log, read_logs
from hardware.rows import RobotRows
from hardware.safety import StopLimits
from sim2real.deployment.deploy import has_base_orientation, run_deployment, servo_task
from sim2real.deployment.robot_env import on_robot
from sim2real.deployment.session import STATE, Deployment, EpisodePlan, load
from sim2real.learning.adapt import NoAdaptation
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.trained import TrainedPolicy
from sim2real.loops.improve.operator import Operator
from sim2real.loops.improve.steps import on_stand
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)
RECORDING = 1  # stream of randomness: motions on the stand
DEPLOYED = "deploy/logs"  # in a round's folder


@dataclass(frozen=True)
class RobotSetup:
    """A robot, and how it is run.

    Raises:
        Sim2RealError: fewer than two trials, a base that no log of the ground tells of, or a return
            that neither the robot nor its operator can measure.
    """

    machine: Robot  # the robot; with a port a real one, which the operator is asked about
    environment: EnvironmentFactory  # the simulator of its task, as given
    operator: Operator  # the person next to a real robot
    trials: int  # episodes of each policy
    settle: float  # how long the start is held before each [s]
    limits: StopLimits  # when the guard stops it
    stand: bool  # whether it is recorded on a stand; else its episodes on the ground are diagnosed
    motions: Sequence[Kind]  # kinds of motion on the stand
    seconds: float  # of each of the two recordings there
    seed: int  # of starts, motions and an emulated robot's noise

    def __post_init__(self) -> None:
        check_trials(self.trials)
        if not self.seconds > 0 or self.settle < 0:
            raise Sim2RealError(
                f"seconds={self.seconds} must be above 0, and settle={self.settle} not below 0 s"
            )
        if not self.stand:
            self._refuse_loose()
        _ = self.task

    @property
    def name(self) -> str:
        """Its name in the loop's files."""
        return self.machine.name

    @property
    def real(self) -> bool:
        """Whether it is more than an emulation."""
        return self.machine.port is not None

    @property
    def absent(self) -> bool:
        """Whether neither a robot nor an emulation that hides something stands for its logs."""
        return self.machine.port is None and self.machine.hidden is None

    def _refuse_loose(self) -> None:
        """Refuse the ground for a robot of whose base nothing tells where it is."""
        model = mujoco.MjModel.from_xml_path(str(self.machine.model))
        why = unobservable_joints_message(model, has_imu=has_base_orientation(self._backend()))
        if why:
            raise Sim2RealError(
                f"stand=false: {self.machine.name} {why}, so its episodes cannot be simulated "
                "again; use stand=true"
            )

    @cached_property
    def task(self) -> ServoTask:
        """The task whose return is known on this robot."""
        task = servo_task(self.environment)
        rows = RobotRows(task, self._backend())
        lacking = rows.needs()[1] - set(rows.backend.sensor_names)
        if not lacking:
            return task
        other = task.with_distance_reward() if lacking == {"position"} else None
        if other is None:
            raise Sim2RealError(
                f"the reward of {type(task).__name__} needs {', '.join(sorted(lacking))}, which "
                f"{self.machine.name} does not measure and a person cannot enter; give it a "
                "tracker (hardware/body.py)"
            )
        return other

    @property
    def by_distance(self) -> bool:
        """Whether a person enters the distance of each episode."""
        return self.task is not servo_task(self.environment)

    def _backend(self) -> ServoBackend:
        return ServoBackend(self.machine, self.settle, limits=self.limits, seed=self.seed)

    def score(self, trained: TrainedPolicy, effects: Sequence = ()) -> list[float]:
        """Return a policy's returns in the simulator with effects, from the robot's starts."""
        world = replace(self.environment, tasks=Randomization(), fixed=effects)
        return trained.run_episodes(
            self._plan(trained).fresh, world.with_task(self.task)
        ).returns.tolist()

    def _plan(self, trained: TrainedPolicy) -> Deployment:
        return Deployment(trained.theta, NoAdaptation(), self.trials, self.seed)

    def deploy(self, trained: TrainedPolicy, folder: Path) -> list[float]:
        """Run a policy on the robot, and return its returns.

        What was interrupted goes on where it was on a real robot; an emulated one starts again,
        so that it does the same as if nothing had happened.

        Raises:
            DeclinedError: the operator did not want it.
            SafetyError: the guard stopped the robot.
            RunInterrupted: after Ctrl-C; torque is off.
        """
        plan = self._plan(trained)
        if (folder / STATE).is_file():
            load(folder, plan)
        if plan.next() is None:
            return plan.before
        if not self.real:
            shutil.rmtree(folder, ignore_errors=True)
            plan = self._plan(trained)
        self._ask(
            f"will run {plan.total - plan.done} episodes of the policy of {folder.parent.name}. "
            "Put it where episodes start, and clear the space around it."
        )
        env = on_robot(trained, self.task, self._backend(), folder / "logs")
        measure = self._measure if self.by_distance else None
        run_deployment(env, trained, plan, folder, measure, resume=folder.parent.parent)
        return plan.before

    def _measure(self, turn: EpisodePlan) -> float:
        return self.operator.distance(f"episode {turn.number + 1} of {self.trials}")

    def record(self, place: Path, number: int) -> list[Log]:
        """Record the robot for the diagnosis of a round.

        Args:
            place: the round's folder; the one before it holds the episodes on the ground.
            number: of the round.

        Returns:
            Recordings on the stand, or the episodes of the round before.
        """
        if not self.stand:
            return read_logs(place.with_name(f"round_{number - 1}") / DEPLOYED)
        folder = place / "stand"
        if not folder.is_dir():
            self._ask(
                f"will be driven along two recordings of {self.seconds:g} s. Hang it on its stand, "
                "so that it touches nothing."
            )
        rng = np.random.default_rng([self.seed, RECORDING, number])
        first = self.seed + 2 * number  # two recordings a round
        on_stand(self.machine, folder, self.motions, self.seconds, self.limits, rng, first)
        return read_logs(folder)

    def _ask(self, what: str) -> None:
        """Ask the operator of a real robot before it moves."""
        if self.real:
            self.operator.consents(f"{self.machine.name} at {self.machine.port} {what}")
        else:
            log_.info("%s %s", self.machine.name, what.split(". ")[0])


def check_trials(trials: int) -> None:
    """Raise Sim2RealError for too few episodes of a policy."""
    if trials < 2:
        raise Sim2RealError(
            f"trials={trials}: at least 2 episodes are needed to estimate their noise"
        )
