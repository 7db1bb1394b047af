"""The verb `relearn`: deploy a policy, find what its simulator lacks, retrain, deploy again.

    python -m sim2real +experiment=hopper2_gap
    python -m sim2real +experiment=hopper2_gap robot.hidden=effects.yaml seed=1
    python -m sim2real +experiment=hopper2_gap resume=outputs/relearn/hopper2_gap/...

The robot is the emulated one, over its bus; what it hides (`robot.hidden`) is known to it alone.

1. `nominal/`: a policy is learned in the simulator as it is, and tried on the robot.
2. `stand/`: the robot is recorded on a stand; `diagnosis/`: what the simulator lacks.
3. `corrected/`: a policy is learned, with the same settings and seed, in the simulator with what
   was found, and tried on the robot.
4. `truth/`: the same with what the robot really hides, which is the best that any diagnosis can do.

What is closed of the gap is (corrected - nominal) / (truth - nominal), returns on the robot.
Everything is on disk after each step; `resume=` continues there.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hardware.backends import ServoBackend
from hardware.excite import Kind
from hardware.rows import RobotRows
from sim2real.deployment import deploy
from sim2real.deployment.session import Deployment
from sim2real.deployment.trained import load_trained
from sim2real.learning.adapt import NoAdaptation
from sim2real.learning.algorithms.base import Algorithm, Parts
from sim2real.learning.trained import Trained
from sim2real.loops.improve.steps import learn
from sim2real.loops.relearn import (
    CORRECTED,
    NOMINAL,
    TRUTH,
    Tried,
    diagnosed,
    emulated,
    report,
)
from sim2real.runs.loggers import Loggers

log_ = logging.getLogger(__name__)


def run(
    *,
    parts: Parts,
    algorithm: Callable[..., Algorithm],
    checkpoint: str | list[str] | None,
    robot: dict[str, Any],
    motions: Sequence[Kind],
    seconds: float,
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
) -> dict[str, Tried]:
    """Close the loop on an emulated robot.

    Args:
        parts: what trains the policy: environment, tasks, transforms, policy, adaptation, ...; like
            the algorithm, a checkpoint's own unless something else was chosen.
        algorithm: makes the algorithm from its parts.
        checkpoint: a policy that was learned in the simulator as it is; None learns one.
        robot: the content of conf/robot/NAME.yaml.
        motions: that show what the robot is like; see `hardware.excite`.
        seconds: the duration of each of the two recordings.
        trials: episodes of each policy, in the simulator and on the robot.
        settle: how long the start is held before each episode on the robot [s].
        stops: when the guard stops the robot, where it differs from `hardware.safety.StopLimits`.
        iterations: the number of iterations of each training; see `train`.
        frames: environment steps of each training; see `train`.
        checkpoint_every: iterations between checkpoints.
        keep_checkpoints: how many of the newest stay.
        logger: further loggers of the trainings.
        seed: the seed of trainings, motions, starts and the diagnosis.
        resume: the folder of a run that was stopped; None starts one in `out`.
        out: the run's folder; gets the folders of the steps, gap.json, table.md, table.csv and
            plots/gap.png.

    Returns:
        What each policy earned, by the name of its folder.

    Raises:
        Sim2RealError: a policy, a robot and settings that do not fit.
        HardwareError: a robot that was stopped on the way.
        Stopped: after Ctrl-C.
    """
    folder, task, machine = (
        Path(resume or out),
        deploy.servo_task(parts.environment),
        emulated(robot),
    )
    training = {
        "algorithm": algorithm,
        "iterations": iterations,
        "frames": frames,
        "logger": logger,
    }
    training |= {"checkpoint_every": checkpoint_every, "keep_checkpoints": keep_checkpoints}
    guard = deploy.guarding(stops)

    def learned(name: str, effects: Path | None) -> Trained:
        if name == NOMINAL and checkpoint is not None:
            return load_trained(checkpoint, parts, algorithm)
        return learn(folder, name, parts.with_effects(effects), training)

    def attempt(name: str, effects: Path | None) -> Tried:
        trained, place = learned(name, effects), folder / name
        backend = ServoBackend(machine, settle, limits=guard, seed=seed)
        rows = RobotRows(task, backend, place / "logs")
        deployment = Deployment(trained.theta, NoAdaptation(), trials, seed)
        deploy.drive(rows, trained, deployment, place)
        at_home = trained.play(deployment.fresh, parts.environment.with_effects(effects)).returns
        log_.info(
            "%s: %.4g in its simulator, %.4g on the robot",
            name,
            at_home.mean(),
            np.mean(deployment.before),
        )
        return Tried(at_home.tolist(), deployment.before)

    tried = {NOMINAL: attempt(NOMINAL, None)}
    found = diagnosed(machine, motions, seconds, deploy.guarding(stops), seed, folder)
    tried[CORRECTED] = attempt(CORRECTED, found)
    if machine.hidden is not None:
        tried[TRUTH] = attempt(TRUTH, machine.hidden)
    report(tried, folder, seed)
    return tried
