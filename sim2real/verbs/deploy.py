"""The verb `deploy`: a trained policy on the robot, as it is and after adapting there.

The policy is run as trained; then it adapts, one episode after the other; then the result is run
from the same starts. After each episode all is on disk. The robot parks when all is done, or
anything else ends it.
"""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hardware.backends import ServoBackend
from sim2real.deployment.deploy import (
    check_base,
    check_reward,
    draw,
    report,
    run_deployment,
    servo_task,
)
from sim2real.deployment.dry_run import tell_commands
from sim2real.deployment.record import configure_robot
from sim2real.deployment.robot_env import on_robot, robot_of
from sim2real.deployment.session import Deployment, load
from sim2real.deployment.stops import make_stop_limits
from sim2real.deployment.trained import load_trained, one_checkpoint, training_adaptation
from sim2real.learning.adapt import Adaptation, NoAdaptation
from sim2real.learning.algorithms.base import Algorithm, Components
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)


def run(
    *,
    parts: Components,
    algorithm: Callable[..., Algorithm],
    checkpoint: str | list[str] | None,
    robot: dict[str, Any],
    port: str | list[str] | None,
    imu_port: str | None,
    calibration: str | None,
    arm: bool,
    dry_run: bool,
    trials: int,
    settle: float,
    stops: dict[str, float] | None,
    resume: str | None,
    seed: int,
    out: Path,
) -> Deployment:
    """Run a trained policy on a robot.

    Args:
        parts: what trains the policy: environment, tasks, transforms, policy, adaptation, ...; like
            the algorithm, a checkpoint's own unless something else was chosen.
        algorithm: makes the algorithm from its parts.
        checkpoint: a checkpoint, or a run's folder.
        robot: the content of conf/robot/NAME.yaml.
        port: its serial port, or those of its buses; None for its own, or the emulated robot.
        imu_port: the serial port of its IMU; None for the robot's own, or none.
        calibration: zeros, signs and limits as `python -m hardware calibrate` wrote them.
        arm: whether a real robot may move.
        dry_run: run the whole loop with torque off: compute commands from what is measured, write
            the log, say what would have been commanded, and do not adapt.
        trials: episodes of the policy as trained, and as many of what it adapted to.
        settle: how long the start is held before each episode [s].
        stops: when the guard stops the robot, where it differs from `hardware.safety.StopLimits`.
        resume: folder of a deployment that was interrupted; None starts one.
        seed: the seed of starts and perturbations.
        out: the run's folder; gets logs/, returns.csv, link.json, table.md, table.csv, plots/ and
            state.npz.

    Returns:
        The deployment, with all its returns.

    Raises:
        Sim2RealError: a policy, a robot and settings that do not fit, before anything moves.
        HardwareError: a robot that is not as its file says, or was stopped on the way.
        RunInterrupted: after Ctrl-C; torque is off.
    """
    one_checkpoint(checkpoint)
    out, task = Path(out), servo_task(parts.environment)
    machine = configure_robot(robot, port, calibration, imu_port)
    if machine.port is not None and not (arm or dry_run):
        raise Sim2RealError(
            f"{machine.name} at {machine.port} would move; clear the space around it, then "
            "add arm=true, or dry_run=true to send nothing"
        )
    if settle < 0:
        raise Sim2RealError(f"settle={settle} must not be below 0 s")
    backend = ServoBackend(
        machine, settle, dry_run=dry_run, limits=make_stop_limits(stops), seed=seed
    )
    trained = load_trained(checkpoint, parts, algorithm)
    env = on_robot(trained, task, backend, out / "logs")
    rows, adapt = robot_of(env), NoAdaptation() if dry_run else parts.adapt
    check_reward(rows, adapt)
    check_base(rows, adapt)
    adapt = adapt.bind_policy(trained.actor(trained.theta), trained.critic).bind_environment(
        trained.environment
    )
    deployment = Deployment(trained.theta, adapt, trials, seed)
    tell(deployment, training_adaptation(checkpoint))
    if resume is not None:
        load(resume, deployment)
        log_.info("continuing after %d of %d episodes", deployment.done, deployment.total)
    try:
        if deployment.done < deployment.total:
            run_deployment(env, trained, deployment, out)
    finally:
        if deployment.done == deployment.total:  # also where parking failed
            report(deployment, trained, task, out)
            if dry_run:
                tell_commands(rows.log.last, out)
            draw(rows, deployment, out / "plots")
    return deployment


def tell(deployment: Deployment, own: Adaptation | None) -> None:
    """Say how many episodes there will be, and whether the policy was trained for this adaptation.

    Args:
        deployment: what is to come.
        own: how it adapted while it was trained; None where that is not known.
    """
    adapt = deployment.adapt
    log_.info("%d episodes in all; adapts by %s", deployment.total, adapt)
    if own is not None and str(own) != str(adapt):
        log_.info("the policy was trained for %s; without adapt= it is deployed so", own)
