"""A trained policy taken out of a checkpoint.

trained = load_policy("outputs/train/udr/2026-11-21_10-00-00")
controller = trained.controller()             # raw observations (n, O) to actions (n, A)
controller = trained.controller(candidate)    # the same network with other parameters
"""

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import yaml

from envs.tasks.base import Task
from sim2real.config.arguments import path_value
from sim2real.config.compose import compose, instantiate
from sim2real.config.inherited import RESOLVED
from sim2real.config.targets import build as build_part
from sim2real.config.targets import check
from sim2real.learning.adapt import Adaptation
from sim2real.learning.algorithms.base import Algorithm, Components, build
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.trained import TrainedPolicy
from sim2real.runs.checkpoint import find, restore, run_folder
from sim2real.runs.errors import Sim2RealError


def load_trained(
    checkpoint: str | list[str] | Path | None,
    parts: Components,
    algorithm: Callable[..., Algorithm],
) -> TrainedPolicy:
    """Build what trained the policy, put it into the checkpoint's state, and take the policy out.

    Args:
        checkpoint: a checkpoint, or a run's folder.
        parts: the algorithm's parts, as in training. How it adapts counts only if training adapts:
            any policy can adapt afterwards, by its parameters.
        algorithm: makes the algorithm.

    Raises:
        Sim2RealError: no checkpoint or several, one that is damaged, or one that does not fit.
    """
    source = find(one_checkpoint(checkpoint))
    learner = build(algorithm, parts, adapts=False)
    with closing(learner):
        restore(source, learner, learner.identity, generators=False)
        return replace(learner.trained(), source=source)


def load_policy(checkpoint: str | Path) -> TrainedPolicy:
    """Return the policy of a run, in the configuration that it was trained with.

    Args:
        checkpoint: a run's folder, or a checkpoint in it.

    Raises:
        Sim2RealError: no such run, a checkpoint that is damaged, or one of another version.
    """
    source = path_value(str(find(checkpoint)))
    _, made = instantiate(compose(["run=export", f"checkpoint={source}", "device=cpu"]), Path())
    return load_trained(checkpoint, made["parts"], made["algorithm"])


def load_teacher(checkpoint: str | Path | None) -> TrainedPolicy:
    """Load the policy that a student is trained from; see `load_policy`.

    Raises:
        Sim2RealError: no run was named, or what `load_policy` refuses.
    """
    if checkpoint is None:
        raise Sim2RealError(
            "a student needs a teacher: give algorithm.teacher.checkpoint=RUN, a run with "
            "transforms=with_params"
        )
    return load_policy(checkpoint)


def training_adaptation(checkpoint: str | list[str] | Path | None) -> Adaptation | None:
    """Return how a policy adapted while it was trained, or None where its run does not say.

    Args:
        checkpoint: a checkpoint, or a run's folder.

    Raises:
        Sim2RealError: no checkpoint or several.
    """
    file = run_folder(find(one_checkpoint(checkpoint))) / RESOLVED
    try:
        tree = yaml.safe_load(file.read_text(encoding="utf-8"))["adapt"]
        check(tree, "adapt")
        return build_part(tree, "adapt")
    except (OSError, KeyError, TypeError, ValueError, yaml.YAMLError):
        return None


def one_checkpoint(checkpoint: str | list[str] | Path | None) -> str | Path:
    """Return the one checkpoint that was given; raises Sim2RealError for none or several."""
    given = checkpoint if isinstance(checkpoint, list) else [checkpoint] if checkpoint else []
    if len(given) != 1:
        what = f"{len(given)} were given" if given else "none was given"
        raise Sim2RealError(f"expected one trained policy, {what}; give checkpoint=PATH")
    return given[0]


def task_of(environment: EnvironmentFactory) -> Task:
    """Return the task that an environment simulates.

    Raises:
        Sim2RealError: an environment without one, such as a toy.
    """
    if environment.task is None:
        raise Sim2RealError(
            f"{environment.name} does not simulate a robot; choose a task of a servo robot, such "
            "as env=quad8"
        )
    return environment.task
