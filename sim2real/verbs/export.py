"""The verb `export`: a trained policy as files for a small computer.

A run that was trained before runs had a policy_interface.json gets one, from today's task and
robot's file; where they have changed since, correct it. Before anything is written, policy.pt2,
policy.npz and the policy itself are compared on a thousand observations, wild ones among them.
"""

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np

from sim2real.deployment.deploy import servo_task
from sim2real.deployment.export import export
from sim2real.deployment.trained import load_trained, one_checkpoint
from sim2real.learning.algorithms.base import Algorithm, Components
from sim2real.learning.interface import interface_file, write_interface

log_ = logging.getLogger(__name__)


def run(
    *,
    parts: Components,
    algorithm: Callable[..., Algorithm],
    checkpoint: str | list[str] | None,
    seed: int,
    out: Path,
) -> Path:
    """Export a trained policy.

    Args:
        parts: what trains the policy: environment, tasks, transforms, policy, adaptation, ...; like
            the algorithm, a checkpoint's own unless something else was chosen.
        algorithm: makes the algorithm from its parts.
        checkpoint: a checkpoint, or a run's folder.
        seed: the seed of the observations that are compared.
        out: the run's folder; gets policy.pt2 (torch.export), policy.npz (for
            `hardware.exported.ExportedPolicy`) and policy.json (robot, servos, rate, observations,
            limits, pairs to check against, hashes).

    Returns:
        The folder.

    Raises:
        Sim2RealError: a checkpoint that does not fit, or a network that is no perceptron.
    """
    one_checkpoint(checkpoint)
    task = servo_task(parts.environment)
    trained = load_trained(checkpoint, parts, algorithm)
    if trained.source is not None and not interface_file(trained.source).is_file():
        added = write_interface(interface_file(trained.source).parent, trained.environment)
        log_.warning("added %s from today's task and robot's file: look whether it holds", added)
    return export(trained, task, Path(out), np.random.default_rng(seed))
