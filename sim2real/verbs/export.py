"""The verb `export`: a trained policy as files for a small computer.

Before anything is written, policy.pt2, policy.npz and the policy itself are compared on a thousand
observations, wild ones among them.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sim2real.deployment.deploy import servo_task
from sim2real.deployment.export import export
from sim2real.deployment.trained import load_trained, one_checkpoint
from sim2real.learning.algorithms.base import Algorithm, Parts


def run(
    *,
    parts: Parts,
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
    return export(trained, task, Path(out), np.random.default_rng(seed))
