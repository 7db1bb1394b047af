r"""The verb `garat`: from demonstrations to a simulator whose actions are changed on their way.

    python -m sim2real +experiment=garat checkpoint=RUN log=demonstrations.csv
    python -m sim2real +experiment=easi_cartpole params=none transforms=grounded \
        transforms.ground.path=outputs/garat/garat/<time>/grounding.npz

The logs hold what the policy of `checkpoint` saw and said on the robot (`obs.*`, `action.*`). It
acts in the simulator that it was trained in, without what training drew and with `effects`, until a
critic hardly knows the simulator's transitions from the robot's; see `sim2real.loops.garat`. A
training with `transforms=grounded` then has the change; no robot and no evaluation on one does.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from envs.randomization import Randomization
from hardware.log import read_logs
from sim2real.deployment.trained import load_policy, one_checkpoint
from sim2real.identification.providers.rollout import transitions
from sim2real.identification.scores.critic import Critic
from sim2real.learning.algorithms.base import Algorithm, Parts
from sim2real.learning.grounding import FILE, write
from sim2real.loops.garat import ground
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.metrics import MetricsFile
from sim2real.runs.progress import Progress

log_ = logging.getLogger(__name__)


def run(
    *,
    parts: Parts,
    algorithm: Callable[..., Algorithm],
    identify: Any,
    log: str | list[str] | None,
    checkpoint: str | list[str] | None,
    effects: str | None,
    frames: int | None,
    out: Path,
) -> Path:
    """Ground a simulator and write what is added to actions.

    Args:
        parts: what the action transformer is trained with; the world is the checkpoint's.
        algorithm: trains it.
        identify: a method whose score is the critic.
        log: a log, a folder of logs, or a list of these.
        checkpoint: the training whose policy made the logs.
        effects: an effects.yaml of the simulator; None for what the checkpoint has.
        frames: environment steps.
        out: the run's folder; gets metrics.csv and grounding.npz.

    Returns:
        The file.

    Raises:
        Sim2RealError: input that cannot work, before any work starts.
        LogError: a log that is damaged.
    """
    if not log or checkpoint is None:
        raise Sim2RealError(
            "garat needs demonstrations and the policy that made them: log=PATH checkpoint=RUN"
        )
    if not frames or frames < 1:
        raise Sim2RealError(f"frames={frames} must be at least 1")
    critic = getattr(identify, "score", None)
    if not isinstance(critic, Critic):
        raise Sim2RealError("garat learns from a critic; choose identify/score=critic_gp")
    trained = load_policy(one_checkpoint(checkpoint))
    environment = replace(trained.environment, tasks=Randomization()).with_effects(effects)
    rows = environment.base_rows(1)
    sizes = rows.observation_size, rows.action_size
    parted = [p for one in read_logs(log) for p in transitions(one, sizes, environment.name)]
    metrics = MetricsFile(Path(out) / "metrics.csv")
    with Progress(frames, "step") as progress:

        def watch(found: dict[str, float], done: int) -> None:
            metrics.write(found)
            progress.update(min(done, frames), done, found["train/critic_gap"])

        module = ground(
            environment.base_rows,
            lambda count: trained.pilot(num_rows=count, explore=parts.seed),
            np.concatenate(parted),
            parts,
            algorithm,
            critic,
            frames,
            watch,
        )
    write(Path(out) / FILE, module)
    log_.info("train with transforms=grounded transforms.ground.path=%s", Path(out) / FILE)
    return Path(out) / FILE
