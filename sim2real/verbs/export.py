"""The verb `export`: a trained policy for a small computer, or found values for another simulator.

    python -m sim2real run=export checkpoint=outputs/train/quad8_es/2026-11-21_10-00-00
    python -m sim2real run=export effects=effects.yaml model=arm.xml to=mjcf       # or to=mjlab

A run that was trained before runs had a policy_interface.json gets one, from today's task and
robot's file; where they have changed since, correct it. Before anything is written, policy.pt2,
policy.npz and the policy itself are compared on a thousand observations, wild ones among them.

Effects are written as MJCF, or as a Python module of event terms for mjlab; what the target cannot
say is refused by name, and nothing is written.
"""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from envs.effects.file import load_effects
from envs.models import load_spec
from sim2real.deployment.deploy import servo_task
from sim2real.deployment.export import export
from sim2real.deployment.mjlab import event_terms, refusal
from sim2real.deployment.trained import load_trained, one_checkpoint
from sim2real.diagnosis.report import model_file
from sim2real.learning.algorithms.base import Algorithm, Components
from sim2real.learning.interface import interface_file, write_interface
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text

log_ = logging.getLogger(__name__)


def run(
    *,
    parts: Components,
    algorithm: Callable[..., Algorithm],
    checkpoint: str | list[str] | None,
    effects: str | None,
    model: str | None,
    to: Literal["mjcf", "mjlab"] | None,
    seed: int,
    out: Path,
) -> Path:
    """Export a trained policy, or effects.

    Args:
        parts: what trains the policy: environment, tasks, transforms, policy, adaptation, ...; like
            the algorithm, a checkpoint's own unless something else was chosen.
        algorithm: makes the algorithm from its parts.
        checkpoint: a checkpoint, or a run's folder.
        effects: an effects.yaml, or the folder of the diagnosis that found it, to export instead.
        model: the MJCF or URDF that the effects were found on.
        to: what the effects become: `mjcf` (model.xml) or `mjlab` (events.py).
        seed: the seed of the observations that are compared.
        out: the run's folder; gets policy.pt2 (torch.export), policy.npz (for
            `hardware.exported.ExportedPolicy`) and policy.json (robot, servos, rate, observations,
            limits, pairs to check against, hashes); or model.xml; or events.py.

    Returns:
        The folder.

    Raises:
        Sim2RealError: a checkpoint that does not fit, a network that is not a perceptron, or
            effects that the target cannot express.
        EffectError: an effects file that is wrong, or an effect that the robot cannot have.
        TaskError: a model that is missing or damaged.
    """
    if effects is not None or to is not None:
        if effects is None or model is None or to is None or checkpoint is not None:
            raise Sim2RealError(
                "export takes a policy (checkpoint=PATH) or effects with the model that they were "
                "found on (effects=PATH model=PATH.xml to=mjcf, or to=mjlab)"
            )
        return _export_effects(effects, model, to, Path(out))
    one_checkpoint(checkpoint)
    task = servo_task(parts.environment)
    trained = load_trained(checkpoint, parts, algorithm)
    if trained.source is not None and not interface_file(trained.source).is_file():
        added = write_interface(interface_file(trained.source).parent, trained.environment)
        log_.warning(
            "added %s from today's task and robot's file: look whether it holds; `deploy` takes "
            "the run now, whether or not it can be exported",
            added,
        )
    return export(trained, task, Path(out), np.random.default_rng(seed))


def _export_effects(effects: str, model: str, to: Literal["mjcf", "mjlab"], out: Path) -> Path:
    """Write effects for another simulator."""
    found, spec = load_effects(effects), load_spec(model)
    if to == "mjlab":
        write_text(out / "events.py", event_terms(spec, found, Path(model).name))
        return out
    reasons = {e.label(): model_file.mjcf_limitation(e) for e, _ in found}
    if refused := {label: reason for label, reason in reasons.items() if reason is not None}:
        raise refusal("mjcf", refused)
    model_file.write(spec, found, out / "model.xml")
    return out
