"""An algorithm's parts, put together of the objects that a configuration names."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from torchrl.envs import EnvBase, Transform

from envs.randomization import Tasks
from sim2real.learning.adapt import Adaptation
from sim2real.learning.algorithms.base import Components
from sim2real.learning.environment import EnvironmentFactory


def build_components(
    *,
    env: partial[EnvBase],
    params: Tasks,
    transforms: Mapping[str, Callable[..., Transform]],
    policy: Callable[..., Any],
    adapt: Adaptation,
    collector: Callable[..., Any] | None,
    advantage: Callable[..., Any] | None,
    loss: Callable[..., Any] | None,
    buffer: Callable[..., Any] | None,
    optimizer: Callable[..., Any] | None,
    seed: int,
    device: str,
) -> Components:
    """Return the parts of a run.

    See `Components` and `EnvironmentFactory`, whose attributes these are.
    """
    environment = EnvironmentFactory(env, params, transforms)
    made = {"collector": collector, "advantage": advantage, "loss": loss}
    made |= {"buffer": buffer, "optimizer": optimizer}
    return Components(environment, policy, seed, adapt, device=device, **made)
