"""Making the algorithm of a run from its parts, and saying what a checkpoint must share with it.

    learner = build(algorithm, env=env, tasks=params, policy=policy, adapt=adapt, seed=0)
    restore(path, learner, expected=identity(learner, env))

The verbs train and evaluate both begin so.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from envs.effects.file import load_effects
from envs.rows import Rows
from sim2real.learning.adapt import NoAdaptation
from sim2real.learning.algorithms.base import Algorithm
from sim2real.runs.errors import Sim2RealError


def build(algorithm: Callable[..., Algorithm], **parts: Any) -> Algorithm:
    """Make the algorithm from those parts that it takes.

    Raises:
        Sim2RealError: a way to adapt for an algorithm whose policy does not adapt.
    """
    takes = inspect.signature(algorithm).parameters
    adapt = parts.get("adapt")
    if "adapt" not in takes and adapt is not None and not isinstance(adapt, NoAdaptation):
        name = getattr(algorithm, "func", algorithm).__name__
        raise Sim2RealError(f"{name} trains no policy that adapts; use adapt=none")
    return algorithm(**{name: part for name, part in parts.items() if name in takes})


def with_effects(env: Callable[..., Rows], effects: str | Path | None) -> Callable[..., Rows]:
    """Return what makes the environment with the effects of a file in it.

    Args:
        env: makes the environment.
        effects: an effects.yaml, or None for the model as it is.

    Raises:
        EffectError: a file that is missing or wrong.
        Sim2RealError: an environment that has no robot to put effects into.
    """
    if effects is None:
        return env
    if "fixed" not in inspect.signature(env).parameters:
        maker = getattr(env, "func", env).__name__
        raise Sim2RealError(
            f"effects={effects}: {maker} simulates no robot that could have them; "
            "leave effects out, or choose an env of the simulator, such as env=hopper"
        )
    return partial(env, fixed=load_effects(effects))


def identity(algorithm: Algorithm, env: Callable[..., Rows]) -> dict[str, Any]:
    """Return what tells whether a checkpoint fits: the task, the algorithm and the policy's shape.

    Args:
        algorithm: as `build` made it.
        env: what makes its environment: a class, or a partial with the task among its arguments.
    """
    given = getattr(env, "keywords", {})
    maker = getattr(env, "func", env)
    policy = getattr(algorithm, "policy", None)
    return {
        "task": type(given["task"]).__name__ if "task" in given else maker.__name__,
        "algorithm": type(algorithm).__name__,
        "policy": dict(getattr(policy, "shape", {})),
    }
