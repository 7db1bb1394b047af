"""Improve by returns: between rounds the distribution to train on moves by what policies earned.

    session = improve_by_returns(site, parts, training, BayRn(), None, out)
    session.result                              # the distribution whose policy earns most

BayRn, see `loops.bayrn`: nothing is diagnosed. Each round trains a policy under normal laws within
the ranges of the training's own tasks and deploys it; a Gaussian process of the returns says where
to train next. The folder of round NN holds distribution.yaml, the policy's run and deploy/.
"""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from envs.distribution import Distribution
from sim2real.identification.prior import prior_from_tasks
from sim2real.learning.algorithms.base import Components
from sim2real.learning.trained import TrainedPolicy
from sim2real.loops.bayrn import BayRn, Session, search, table
from sim2real.loops.improve.operator import DeclinedError
from sim2real.loops.improve.site import RobotSetup
from sim2real.loops.improve.steps import learn, longer
from sim2real.loops.improve.story import WORDS
from sim2real.loops.improve.target import Target

log_ = logging.getLogger(__name__)


def improve_by_returns(
    site: RobotSetup | Target,
    parts: Components,
    training: dict[str, Any],
    recipe: BayRn,
    first: TrainedPolicy | None,
    out: Path,
) -> Session:
    """Train under one distribution after another, until all rounds are done or a person ends it.

    Args:
        site: the robot, or what stands for it.
        parts: what trains the policies; the ranges of its tasks are the prior.
        training: `algorithm`, further settings of `train`, and the iterations or frames of a round.
        recipe: how distributions are chosen.
        first: the policy that each training goes on from; None trains each from scratch.
        out: the folder of the loop; what it holds is gone on with.

    Raises:
        Sim2RealError: tasks without ranges, a folder of another loop.
        HardwareError: a robot that is wrong, or was stopped on the way.
        RunInterrupted: after Ctrl-C; what was done is on disk.
    """
    session = recipe.start(prior_from_tasks(parts.tasks), site.seed)
    source = None if first is None else first.source
    settings = training if source is None else longer(training, source)

    def attempt(distribution: Distribution, name: str) -> float:
        own = replace(parts, environment=replace(parts.environment, tasks=distribution))
        made = learn(out, name, own, settings, start=source)
        returns = site.deploy(made, out / name / "deploy")
        text = "%s: %.4g on the robot, mean of %d episodes"
        log_.info(text, name, np.mean(returns), len(returns))
        return float(np.mean(returns))

    try:
        search(session, attempt, out)
    except DeclinedError:
        text = "it ended because %s; to go on, run the same command with resume=%s"
        log_.info(text, WORDS["declined"], out)
        return session
    log_.info("%s", table(session).markdown())
    log_.info("the best policy is in %s", out / f"{session.best + 1:02d}")
    return session
