r"""The verb `close_loop`: from a robot's episodes to the simulator that its policy should train in.

    python -m sim2real +experiment=hopper_gap
    python -m sim2real run=close_loop checkpoint=outputs/train/ppo_source/2026-11-21_10-00-00 \
        +env@target=hopper_polito target.task.domain=target target.task.masses=legacy

`target` stands for the robot: a task whose state is all known. A few of its episodes are recorded,
of a trained policy or of random actions, and `env`, the simulator that the policy knows, is
diagnosed against them. What was found is in effects.yaml, with which training goes on:

    python -m sim2real +experiment=ppo_source effects=outputs/close_loop/.../effects.yaml eval=none

With a checkpoint the policy is also played in both simulators and on the target, so that the
returns show how much of the gap is closed for it before anything is trained again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from envs.randomization import Tasks
from envs.rows import Rows
from hardware.log import write_log
from sim2real.diagnosis.diagnose import run_diagnosis, write
from sim2real.diagnosis.report import words
from sim2real.diagnosis.schema import Report
from sim2real.evaluation.evaluate import find_runs
from sim2real.learning.adapt import Adaptation
from sim2real.learning.algorithms.base import Algorithm
from sim2real.learning.learner import build, identity
from sim2real.learning.modules.policy import MLPPolicy
from sim2real.learning.population.population import draw_seeds
from sim2real.loops.close_loop import (
    EFFECTS,
    PIECE,
    RECORDING,
    acting,
    compare,
    cut,
    named,
    noise,
    one_simulation,
    record,
)
from sim2real.runs.checkpoint import restore
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text

log_ = logging.getLogger(__name__)


def run(
    *,
    env: Callable[..., Rows],
    target: Callable[..., Rows] | None,
    params: Tasks,
    policy: Callable[..., MLPPolicy],
    adapt: Adaptation,
    algorithm: Callable[..., Algorithm],
    checkpoint: str | list[str] | None,
    episodes: int,
    seed: int,
    device: str,
    out: Path,
) -> Report:
    """Record, diagnose, and say what a policy's return makes of it.

    Args:
        env: makes the simulator that is diagnosed; like all down to `algorithm` it is the
            checkpoint's own unless it was chosen.
        target: makes what stands for the robot.
        params: the tasks that the policy was trained on.
        policy: makes the policy.
        adapt: how it adapts.
        algorithm: makes the algorithm.
        checkpoint: a trained policy, which then moves the target; None for random actions.
        episodes: to record.
        seed: of the target's episodes and of the diagnosis.
        device: where networks are.
        out: the run's folder; gets log.csv, source.xml, all that `diagnose` writes, and with a
            checkpoint returns.md and returns.csv.

    Returns:
        The diagnosis.

    Raises:
        Sim2RealError: no target, no episodes, or worlds that are no simulations of one robot.
    """
    if target is None or episodes < 1:
        raise Sim2RealError(
            f"close_loop needs a target and episodes of it, not episodes={episodes}; "
            "start from +experiment=hopper_gap"
        )
    source, robot = one_simulation(env, "env"), one_simulation(target, "target", episodes)
    module = None
    if checkpoint is not None:
        parts = {"env": env, "tasks": params, "policy": policy, "adapt": adapt, "device": device}
        learner = build(algorithm, **parts, seed=seed)
        (found,) = list(find_runs(checkpoint).values())[:1]
        restore(found, learner, identity(learner, env), generators=False)
        module = learner.module()
    rng = np.random.default_rng([seed, RECORDING])
    act = noise(robot, rng) if module is None else acting(module)
    log = record(robot, act, draw_seeds(rng, episodes))
    model = write_text(out / "source.xml", named(source.task.spec()).to_xml())
    log = replace(log, meta={**log.meta, "model": str(model.resolve())})
    log = replace(log, path=write_log(out / "log.csv", log))
    found = run_diagnosis([cut(log, PIECE)], model, None, (), seed, None)
    write(found, out)
    log_.info("%s", words.sentence(found.report))
    if module is not None:
        compare(env, target, module, out, seed)
    log_.info("train in the corrected simulator with effects=%s", out / EFFECTS)
    return found.report
