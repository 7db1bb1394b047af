r"""The verb `bayrn`: train under the distribution of robots whose policy earns most on the robot.

    python -m sim2real run=bayrn +experiment=udr +env@target=hopper_polito \
        target.task.domain=target target.task.masses=legacy frames=300000
    python -m sim2real run=bayrn env=quad8 params=quad8_dr robot=quad8 iterations=40 \
        robot.hidden=conf/shift/quad8_side_mass.yaml

Each round trains a policy under normal laws within the ranges of `params`, lets it act on the
robot, and tells a Gaussian process what it earned; see `sim2real.loops.bayrn`. The robot is
`target`, a task that stands for it, or else the emulated `robot`, over its bus.

Each round's folder NN holds distribution.yaml and the policy's run; the run's own holds table.md
and the best distribution. After each round all is on disk; `resume=FOLDER` continues.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from torchrl.envs import EnvBase

from envs.distribution import Distribution
from hardware.backends import ServoBackend
from hardware.rows import RobotRows
from sim2real.deployment import deploy
from sim2real.deployment.session import Deployment
from sim2real.identification.prior import of_tasks
from sim2real.learning.adapt import NoAdaptation
from sim2real.learning.algorithms.base import Algorithm, Parts
from sim2real.learning.population.population import draw_seeds
from sim2real.learning.trained import Trained
from sim2real.loops.bayrn import BayRn, Session, search, table
from sim2real.loops.improve.steps import learn
from sim2real.loops.relearn import emulated
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.loggers import Loggers

log_ = logging.getLogger(__name__)
BETWEEN = (
    "would stand still for hours: a training lies between any two of its turns, so run=bayrn takes "
    "emulated robots and targets alone; leave the port out, or ask sim2real.loops.bayrn.BayRn for "
    "distributions and tell it what run=deploy returns"
)
TRYING = 1  # stream of randomness: the episodes on the target, the same for all policies


def run(
    *,
    parts: Parts,
    algorithm: Callable[..., Algorithm],
    bayrn: BayRn,
    target: partial[EnvBase] | None,
    robot: dict[str, Any],
    trials: int,
    settle: float,
    stops: dict[str, float] | None,
    iterations: int | None,
    frames: int | None,
    checkpoint_every: int,
    keep_checkpoints: int,
    logger: Loggers,
    seed: int,
    resume: str | None,
    out: Path,
) -> Session:
    """Search for the distribution to train under.

    Args:
        parts: what trains the policies; the ranges of its tasks are the prior.
        algorithm: makes the algorithm from its parts.
        bayrn: how distributions are chosen.
        target: makes what stands for the robot; None for the emulated robot.
        robot: the content of conf/robot/NAME.yaml.
        trials: episodes of each policy on the robot.
        settle: how long the start is held before each episode on the servo robot [s].
        stops: when the guard stops it, where that differs from `hardware.safety.StopLimits`.
        iterations: the number of iterations of each training; see `train`.
        frames: environment steps of each training; see `train`.
        checkpoint_every: iterations between checkpoints.
        keep_checkpoints: how many of the newest stay.
        logger: further loggers of the trainings.
        seed: the seed of the search, the trainings and the episodes on the robot.
        resume: the folder of a run that was stopped; None starts one in `out`.
        out: the run's folder; see the module's text.

    Returns:
        The search at its end.

    Raises:
        Sim2RealError: tasks without ranges, no trials, a robot at a port, a search to resume that
            is another one.
        HardwareError: a robot that was stopped on the way.
        Stopped: after Ctrl-C.
    """
    if trials < 1:
        raise Sim2RealError(f"trials={trials} must be at least 1")
    folder, session = Path(resume or out), bayrn.start(of_tasks(parts.tasks), seed)
    training = {
        "algorithm": algorithm,
        "iterations": iterations,
        "frames": frames,
        "logger": logger,
    }
    training |= {"checkpoint_every": checkpoint_every, "keep_checkpoints": keep_checkpoints}
    if target is None:
        machine, guard = emulated(robot, BETWEEN), deploy.guarding(stops)

        def returned(trained: Trained, place: Path) -> list[float]:
            backend = ServoBackend(machine, settle, limits=guard, seed=seed)
            return on_servos(trained, backend, trials, seed, place)
    else:
        stand_in = parts.environment.over(target)
        seeds = draw_seeds(np.random.default_rng([seed, TRYING]), trials)

        def returned(trained: Trained, place: Path) -> list[float]:
            return trained.play(seeds, stand_in).returns.tolist()

    def attempt(distribution: Distribution, name: str) -> float:
        own = replace(parts, environment=replace(parts.environment, tasks=distribution))
        returns = returned(learn(folder, name, own, training), folder / name)
        log_.info("%s: %.4g on the robot, mean of %d episodes", name, np.mean(returns), trials)
        return float(np.mean(returns))

    search(session, attempt, folder)
    log_.info("%s", table(session).markdown())
    log_.info("the best policy is in %s", folder / f"{session.best + 1:02d}")
    return session


def on_servos(
    trained: Trained, backend: ServoBackend, trials: int, seed: int, place: Path
) -> list[float]:
    """Return what a policy earns in each of its episodes on a servo robot."""
    rows = RobotRows(deploy.servo_task(trained.environment), backend, place / "logs")
    deployment = Deployment(trained.theta, NoAdaptation(), trials, seed)
    deploy.drive(rows, trained, deployment, place)
    return list(deployment.before)
