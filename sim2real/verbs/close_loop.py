r"""The verb `close_loop`: from a robot's episodes to the simulator that its policy should train in.

    python -m sim2real +experiment=hopper_gap
    python -m sim2real run=close_loop checkpoint=outputs/train/ppo_source/2026-11-21_10-00-00 \
        +env@target=hopper_polito target.task.domain=target target.task.masses=legacy

`target` stands for the robot: a task whose state is all known. A few of its episodes are recorded,
of a trained policy or of random actions, and `env`, the simulator that the policy knows, is
diagnosed against them. What was found is in effects.yaml, with which training continues:

    python -m sim2real +experiment=ppo_source effects=outputs/close_loop/.../effects.yaml eval=none

With a checkpoint the policy is also played in both simulators and on the target, so that the
returns show how much of the gap is closed for it before anything is trained again.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from torchrl.envs import EnvBase

from envs.models import named
from hardware.log import write_log
from sim2real.deployment.trained import load_trained
from sim2real.diagnosis.diagnose import run_diagnosis
from sim2real.diagnosis.outcome import write
from sim2real.diagnosis.report import words
from sim2real.diagnosis.schema import Report
from sim2real.evaluation.evaluate import find_runs
from sim2real.learning.algorithms.base import Algorithm, Parts
from sim2real.learning.population.population import draw_seeds
from sim2real.learning.population.recording import record
from sim2real.loops.close_loop import (
    EFFECTS,
    PIECE,
    RECORDING,
    compare,
    cut,
    noise,
    one_simulation,
)
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text

log_ = logging.getLogger(__name__)


def run(
    *,
    parts: Parts,
    algorithm: Callable[..., Algorithm],
    target: partial[EnvBase] | None,
    checkpoint: str | list[str] | None,
    episodes: int,
    seed: int,
    out: Path,
) -> Report:
    """Record, diagnose, and say what a policy's return makes of it.

    Args:
        parts: what trains the policy: environment, tasks, transforms, policy, adaptation, ...; like
            the algorithm, a checkpoint's own unless something else was chosen.
        algorithm: makes the algorithm from its parts.
        target: makes what stands for the robot.
        checkpoint: a trained policy, which then moves the target; None for random actions.
        episodes: the number of episodes to record.
        seed: the seed of the target's episodes and of the diagnosis.
        out: the run's folder; gets log.csv, source.xml, all that `diagnose` writes, and with a
            checkpoint returns.md and returns.csv.

    Returns:
        The diagnosis.

    Raises:
        Sim2RealError: no target, no episodes, or worlds that are no simulations of one robot.
    """
    if target is None:
        raise Sim2RealError(
            "close_loop needs a target, which stands for the robot: start from "
            "+experiment=hopper_gap, or add +env@target=hopper_polito"
        )
    if episodes < 1:
        raise Sim2RealError(f"episodes={episodes} must be at least 1")
    stand_in = parts.environment.over(target)
    source = one_simulation(parts.environment.over(parts.environment.base), "env")
    robot, trained = one_simulation(stand_in, "target", episodes), None
    if checkpoint is not None:
        (first,) = list(find_runs(checkpoint).values())[:1]
        trained = load_trained(first, parts, algorithm)
    rng = np.random.default_rng([seed, RECORDING])
    act = noise(robot, rng) if trained is None else trained.pilot(num_rows=episodes)
    log = record(robot, act, draw_seeds(rng, episodes)).log
    model = write_text(out / "source.xml", named(source.task.spec()).to_xml())
    log = replace(log, meta={**log.meta, "model": str(model.resolve())})
    log = replace(log, path=write_log(out / "log.csv", log))
    found = run_diagnosis([cut(log, PIECE)], model, None, (), seed, None)
    write(found, out)
    log_.info("%s", words.sentence(found.report))
    if trained is not None:
        compare(trained, stand_in, out, seed)
    log_.info("train in the corrected simulator with effects=%s", out / EFFECTS)
    return found.report
