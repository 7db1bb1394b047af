"""The verb `improve`: deploy a policy, find what its simulator lacks, retrain, deploy again."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from torchrl.envs import EnvBase

from hardware.excite import Kind
from hardware.log import Log, read_logs
from sim2real.deployment.record import configure_robot
from sim2real.deployment.stops import make_stop_limits
from sim2real.deployment.trained import load_trained
from sim2real.learning.algorithms.base import Algorithm, Components
from sim2real.loops.bayrn import BayRn, Session
from sim2real.loops.improve.improve import Improvement, Plan, improve
from sim2real.loops.improve.operator import Operator
from sim2real.loops.improve.returns import improve_by_returns
from sim2real.loops.improve.site import RobotSetup
from sim2real.loops.improve.target import Target
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.loggers import Loggers

log_ = logging.getLogger(__name__)
WAYS = ("diagnosis", "returns")  # what moves the simulator between rounds


def run(
    *,
    parts: Components,
    algorithm: Callable[..., Algorithm],
    checkpoint: str | list[str] | None,
    by: str,
    bayrn: BayRn | None,
    target: partial[EnvBase] | None,
    robot: dict[str, Any],
    port: str | list[str] | None,
    imu_port: str | None,
    calibration: str | None,
    arm: bool,
    rounds: int,
    tolerance: float,
    trials: int,
    settle: float,
    stops: dict[str, float] | None,
    stand: bool,
    motions: Sequence[Kind],
    seconds: float,
    log: str | list[str] | None,
    model: str | None,
    rollouts: int,
    iterations: int | None,
    frames: int | None,
    checkpoint_every: int,
    keep_checkpoints: int,
    logger: Loggers,
    seed: int,
    resume: str | None,
    out: Path,
) -> Improvement | Session:
    """Improve a policy on a robot.

    Args:
        parts: what trains the policy: environment, tasks, transforms, policy, adaptation, ...; like
            the algorithm, a checkpoint's own unless something else was chosen.
        algorithm: makes the algorithm from its parts.
        checkpoint: the policy as given: a checkpoint, or a run's folder; by returns it may be None,
            and each round's policy is then trained from scratch.
        by: what moves the simulator between rounds: "diagnosis" of the robot's recordings, or the
            "returns" of policies, by Bayesian optimization.
        bayrn: how that chooses distributions.
        target: makes what stands for the robot; None for the robot.
        robot: the content of conf/robot/NAME.yaml.
        port: its serial port, or those of its buses; None for its own, or the emulated robot.
        imu_port: the serial port of its IMU; None for the robot's own, or none.
        calibration: zeros, signs and limits as `python -m hardware calibrate` wrote them.
        arm: whether a real robot may move.
        rounds: trainings at most.
        tolerance: relative difference below which returns count as equal.
        trials: episodes of each policy on the robot, at least 2.
        settle: how long the start is held before each episode [s].
        stops: when the guard stops the robot, where it differs from `hardware.safety.StopLimits`.
        stand: whether the robot is recorded on a stand; else its own episodes are diagnosed.
        motions: kinds of motion on the stand; see `hardware.excite`.
        seconds: of each of the two recordings on the stand.
        log: recordings of the robot that the first round starts from; None records them.
        model: an MJCF for these; None: the model that each names.
        rollouts: episodes on each simulated robot that price the causes.
        iterations: that each round adds; None for no limit.
        frames: environment steps that each round adds; None for no limit.
        checkpoint_every: iterations between checkpoints.
        keep_checkpoints: how many of the newest stay.
        logger: further loggers of the trainings.
        seed: of starts, motions, diagnoses and intervals.
        resume: the folder of a loop that was stopped; None starts one in `out`.
        out: the run's folder; gets round_0/, round_1/, ..., improve.json, improve.md, improve.csv
            and plots/improve.png.

    Returns:
        How it ended; its `exit_status` is that of the process.

    Raises:
        Sim2RealError: a policy, a robot and settings that do not fit, a target given with a port or
            logs, or a real robot that was not armed, before anything moves.
        HardwareError: a robot that is not as its file says.
        RunInterrupted: after Ctrl-C; torque is off, and what was done is on disk.
    """
    if by not in WAYS:
        raise Sim2RealError(f"by={by} is none of {', '.join(WAYS)}")
    if log and (target is not None or by == "returns"):
        raise Sim2RealError(
            "log= needs a servo robot and a diagnosis; remove log=, target= or by=returns"
        )
    if model is not None and not log:
        raise Sim2RealError("model= needs the logs that the loop starts from; give log=PATH")
    site: RobotSetup | Target
    if target is not None:
        if port is not None:
            raise Sim2RealError("target= replaces the robot; remove port= or target=")
        site = Target(parts.environment.with_base(target), parts.environment, trials, seed)
    else:
        machine = configure_robot(robot, port, calibration, imu_port)
        if machine.port is not None and not arm:
            raise Sim2RealError(
                f"{machine.name} at {machine.port} would move; clear the space around it, then "
                "add arm=true: you are asked before each motion"
            )
        limits, kinds = make_stop_limits(stops), tuple(motions)
        about = (trials, settle, limits, stand, kinds, seconds, seed)
        site = RobotSetup(machine, parts.environment, Operator(), *about)
    training = {
        "algorithm": algorithm,
        "iterations": iterations,
        "frames": frames,
        "logger": logger,
        "checkpoint_every": checkpoint_every,
        "keep_checkpoints": keep_checkpoints,
    }
    folder = Path(resume or out)
    if by == "returns":
        first = None if checkpoint is None else load_trained(checkpoint, parts, algorithm)
        return improve_by_returns(site, parts, training, bayrn or BayRn(), first, folder)
    logs = _recordings(log, model)
    absent = bool(logs) and isinstance(site, RobotSetup) and site.absent
    plan = Plan(rounds, tolerance, rollouts, logs, absent)
    first = load_trained(checkpoint, parts, algorithm)
    outcome = improve(site, parts, training, first, plan, folder)
    if outcome.story.rounds:
        log_.info("%s", outcome.story.table().markdown())
    return outcome


def _recordings(log: str | list[str] | None, model: str | None) -> list[Log]:
    """Return the logs to start from, with the model that was given for them."""
    logs = read_logs(log) if log else []
    if model is None:
        return logs
    place = str(Path(model).expanduser().resolve())
    return [replace(one, meta={**one.meta, "model": place}) for one in logs]
