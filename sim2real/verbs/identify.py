"""The verb `identify`: from a robot's logs to a distribution of simulators."""

import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from envs.distribution import Distribution
from envs.effects import load_effects
from envs.plant import Fixed
from envs.randomization import Tasks
from hardware.log import read_logs
from sim2real.identification.data import PolicySimulation, Recordings
from sim2real.identification.identify import identify as find
from sim2real.identification.identify import prior_of
from sim2real.identification.methods.base import FitContext
from sim2real.identification.outcome import Outcome, format_cells, table, warnings, write
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.progress import Progress

log_ = logging.getLogger(__name__)


def run(
    *,
    log: str | list[str] | None,
    model: str | None,
    effects: str | None,
    candidates: str | list[str] | None,
    params: Tasks,
    identify: Any,
    seed: int,
    checkpoint: str | list[str] | None,
    resume: str | None,
    out: Path,
) -> Outcome:
    """Fit a distribution to logs and write it.

    Args:
        log: a log, a folder of logs, or a list of these.
        model: an MJCF for all logs; None: the model that each log names.
        effects: an effects.yaml of what is known already; put into the model first.
        candidates: the report.json of a diagnosis (or its folder), or names of effects; None:
            the prior is `params`.
        params: what a training draws, as a prior.
        identify: the method; its provider, score and search are its own.
        seed: all randomness follows from it.
        checkpoint: the training whose policy made the logs, for a provider that rolls out.
        resume: the folder of a run to go on from, all other keys the same; None starts a new one.
        out: the run's folder; gets distribution.yaml, table.md, table.csv, identify.json and
            plots/parameters.png, each whole or absent.

    Returns:
        The distribution, its prior, and what held-out recordings say.

    Raises:
        Sim2RealError: input that cannot work, before any work starts.
        LogError: a log that is damaged, or names what the model lacks.
        EffectError: an effects file that is wrong, or an effect that the robot cannot have.
    """
    if not log:
        raise Sim2RealError("identify needs a recording; give log=PATH")
    fixed = [] if effects is None else load_effects(effects)
    data = Recordings(read_logs(log), model, fixed)
    prior = prior_of(candidates, params, data)
    if checkpoint is not None:
        data = replace(data, world=_world(checkpoint, prior, fixed, seed))
    with Progress(total=1, unit="generation") as progress:
        watch = FitContext(
            seed,
            Path(out),
            None if resume is None else Path(resume),
            lambda done, total, best: progress.report(done, total),
        )
        outcome = find(data, identify, prior, identify.provider, watch)
    write(outcome, Path(out))
    log_.info("the robot's parameters\n%s", format_cells(table(outcome)).markdown())
    for words in warnings(outcome):
        log_.warning("%s", words)
    return outcome


def _world(
    checkpoint: str | list[str], prior: Distribution, fixed: Sequence[Fixed], seed: int
) -> PolicySimulation:
    """Return the checkpoint's policy in the simulator that it was trained in, for rollouts.

    It draws its actions, as EASI's does. This imports torch.
    """
    from sim2real.deployment.trained import load_policy, one_checkpoint

    trained = load_policy(one_checkpoint(checkpoint))
    environment = replace(trained.environment, tasks=prior, fixed=tuple(fixed))
    return PolicySimulation(
        lambda effects, rows: environment.base_rows(rows),
        lambda rows: trained.controller(num_rows=rows, explore=seed),
        environment.name,
    )
