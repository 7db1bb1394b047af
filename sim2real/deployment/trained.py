"""A trained policy taken out of a checkpoint: a function of observations, and its parameters.

    trained = load_trained(checkpoint, env=env, params=params, policy=policy, adapt=adapt,
                           algorithm=algorithm, device="cpu", seed=0)
    module = trained.module(trained.theta)          # raw observation (..., O) to action (..., A)
    module = trained.module(candidate)              # the same network with other parameters

It hides which algorithm trained the policy. Evolution strategies keep their parameters in one
vector already; of any other policy the vector is that of its module's parameters, in their order.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn
from torch.nn.utils import parameters_to_vector, vector_to_parameters

from envs.randomization import Tasks
from envs.rows import Rows
from envs.tasks.base import Task
from sim2real.learning.adapt import Adaptation
from sim2real.learning.algorithms.base import Algorithm
from sim2real.learning.algorithms.esmaml import ESMAML
from sim2real.learning.learner import build, identity
from sim2real.learning.modules.normalizer import Normalizer
from sim2real.runs.checkpoint import find, restore
from sim2real.runs.errors import Sim2RealError

Act = Callable[[np.ndarray], np.ndarray]  # raw observation (O,) to action (A,)


@dataclass(frozen=True)
class Trained:
    """A trained policy.

    Attributes:
        theta: its parameters, (P,) float32.
        module: makes the policy with given parameters, (P,): a deterministic torch module from raw
            observations (..., O) to actions (..., A) on the CPU.
        source: the checkpoint.
        frames: environment steps of its training.
    """

    theta: np.ndarray
    module: Callable[[np.ndarray], nn.Module]
    source: Path
    frames: int


def load_trained(
    checkpoint: str | list[str] | Path | None,
    *,
    env: Callable[..., Rows],
    params: Tasks,
    policy: Callable[..., Any],
    adapt: Adaptation,
    algorithm: Callable[..., Algorithm],
    device: str,
    seed: int,
) -> Trained:
    """Build what trained the policy, put it into the checkpoint's state, and take the policy out.

    Args:
        checkpoint: a checkpoint, or a run's folder.
        env: makes the environment, as in training.
        params: the tasks that it was trained on.
        policy: makes the policy.
        adapt: how it adapts.
        algorithm: makes the algorithm.
        device: where networks are while they are restored.
        seed: of nothing that is kept.

    Raises:
        Sim2RealError: no checkpoint or several, one that is damaged, or one that does not fit.
    """
    source = find(one_checkpoint(checkpoint))
    parts = {"env": env, "tasks": params, "policy": policy, "device": device}
    if "adapt" in inspect.signature(algorithm).parameters:
        parts["adapt"] = adapt  # others' policies adapt all the same, by their parameters
    learner = build(algorithm, **parts, seed=seed)
    restore(source, learner, identity(learner, env), generators=False)
    return take(learner, source)


def take(learner: Algorithm, source: Path) -> Trained:
    """Return an algorithm's present policy; `source` is where it is from."""
    if isinstance(learner, ESMAML):
        seen = learner.normalizer or Normalizer(learner.policy.observation_size)
        shape, mean, std = learner.policy, seen.mean.copy(), seen.std.copy()
        return Trained(
            learner.theta, lambda theta: shape.module(theta, mean, std), source, learner.frames
        )
    module = learner.module().cpu().eval()
    theta = parameters_to_vector(module.parameters()).detach().numpy().astype(np.float32)

    def make(theta: np.ndarray) -> nn.Module:
        copy = deepcopy(module)
        vector_to_parameters(torch.from_numpy(np.asarray(theta, np.float32)), copy.parameters())
        return copy

    return Trained(theta, make, source, learner.frames)


def one_checkpoint(checkpoint: str | list[str] | Path | None) -> str | Path:
    """Return the one checkpoint that was given; raises Sim2RealError for none or several."""
    given = checkpoint if isinstance(checkpoint, list) else [checkpoint] if checkpoint else []
    if len(given) != 1:
        what = f"{len(given)} were given" if given else "none was given"
        raise Sim2RealError(f"one trained policy is needed, {what}; give checkpoint=PATH")
    return given[0]


def task_of(env: Callable[..., Rows]) -> Task:
    """Return the task that an environment simulates.

    Raises:
        Sim2RealError: an environment without one, such as a toy.
    """
    task = getattr(env, "keywords", {}).get("task")
    if not isinstance(task, Task):
        name = getattr(getattr(env, "func", env), "__name__", "this")
        raise Sim2RealError(
            f"{name} is no robot's world; choose a task of a servo robot, such as env=quad8"
        )
    return task


def acting(module: nn.Module) -> Act:
    """Return a torch policy as a function of arrays: observation (O,) to action (A,)."""

    def act(observation: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return module(torch.from_numpy(observation)[None])[0].numpy().astype(np.float64)

    return act
