"""The verb `evaluate`: a policy on robots that it was never trained on, before and after it adapts.

    python -m sim2real run=evaluate checkpoint=outputs/train/esmaml/2026-11-21_10-00-00
    python -m sim2real run=evaluate checkpoint=[RUN_A,RUN_B,RUN_C]     # several seeds, one table

In each cell of the grid the policy adapts several times, each time from the trained parameters,
with perturbations and luck of its own. Each result is scored on fresh episodes whose start noise
the adaptation has not seen, and the policy before adaptation on the same episodes, so that their
difference carries no luck. Every cell, adaptation and episode is a row of the same batches.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from envs.randomization import Tasks
from envs.rows import Rows
from sim2real.evaluation.evaluate import Assessment, find_runs
from sim2real.learning.adapt import Adaptation
from sim2real.learning.algorithms.base import Algorithm
from sim2real.learning.learner import build, identity, with_effects
from sim2real.learning.modules.policy import MLPPolicy
from sim2real.runs.checkpoint import restore
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.progress import Progress


def run(
    *,
    env: Callable[..., Rows],
    effects: str | None,
    params: Tasks,
    policy: Callable[..., MLPPolicy],
    adapt: Adaptation,
    algorithm: Callable[..., Algorithm],
    eval: Assessment | None,
    checkpoint: str | list[str] | None,
    seed: int,
    device: str,
    out: Path,
) -> Any:
    """Evaluate trained policies.

    Args:
        env: makes the environment; like all down to `algorithm` it is the checkpoint's own unless
            it was chosen.
        effects: an effects.yaml that is put into the simulator; None for the model as it is.
        params: the tasks that it was trained on.
        policy: makes the policy.
        adapt: how it adapts.
        algorithm: makes the algorithm.
        eval: what to evaluate.
        checkpoint: a checkpoint, a run's folder, a folder of runs, or a list of these; several
            become one table.
        seed: of the evaluation; all runs get the same luck.
        device: where networks are.
        out: the run's folder.

    Returns:
        The scores of all runs.

    Raises:
        Sim2RealError: nothing to evaluate, or a checkpoint that is damaged or does not fit.
    """
    if eval is None:
        raise Sim2RealError("eval=null leaves nothing to evaluate; choose eval=NAME")
    env = with_effects(env, effects)
    parts = {"env": env, "tasks": params, "policy": policy, "adapt": adapt, "device": device}
    sources = find_runs(checkpoint)
    learner = build(algorithm, **parts, seed=seed)
    expected = identity(learner, env)
    scores = []
    with Progress(1, "task") as progress:
        for number, (name, source) in enumerate(sources.items()):
            restore(source, learner, expected, generators=False)

            def report_all(done: int, total: int, number: int = number) -> None:
                progress.report(number * total + done, len(sources) * total)

            scores.append(eval.assess(learner, env, seed, name, report_all))
    return eval.report(scores, seed, Path(out))
