"""Environments of other libraries, by TorchRL's wrappers.

    sim2real env=gymnasium env.id=AdroitHandDoor-v1 env.package=gymnasium_robotics algorithm=ppo

They simulate by themselves: there is no robot here that effects could change. TorchRL has wrappers
for some twenty libraries; a function like these, in a folder of your own, brings another one.
"""

from functools import partial
from importlib import import_module
from importlib.util import find_spec

import torch
from torchrl.envs import (
    DoubleToFloat,
    EnvBase,
    GymEnv,
    MJLabEnv,
    RenameTransform,
    SerialEnv,
    TransformedEnv,
)

from envs.errors import TaskError


def gymnasium(
    num_envs: int, device: torch.device | str, id: str, package: str | None = None
) -> EnvBase:
    """Return environments of Gymnasium, or of a package that registers some there.

    Args:
        num_envs: how many, one after the other in this process.
        device: where tensors are.
        id: such as `Pendulum-v1`.
        package: such as `gymnasium_robotics`; None for Gymnasium's own.

    Raises:
        TaskError: a package that is not installed, or an id that is not registered.
    """
    from gymnasium import error, register_envs, spec

    if package is not None:
        if find_spec(package) is None:
            raise TaskError(
                f"{id} needs {package}; install it with: pip install {package.replace('_', '-')}"
            )
        register_envs(import_module(package))
    try:
        spec(id)
    except error.Error as reason:
        raise TaskError(
            f"env.id={id}: {reason}; env.package must name the package that registers it"
        ) from None
    return TransformedEnv(SerialEnv(num_envs, partial(GymEnv, id, device=device)), DoubleToFloat())


def mjlab(num_envs: int, device: torch.device | str, id: str) -> EnvBase:
    """Return a task of mjlab, in worlds that MuJoCo Warp steps.

    Args:
        num_envs: how many worlds.
        device: where they are stepped.
        id: such as `Mjlab-Cartpole-Balance`.

    Raises:
        TaskError: mjlab is not installed.
    """
    if find_spec("mjlab") is None:
        raise TaskError(
            f"{id} needs mjlab, and mjlab 1.6 needs MuJoCo 3.11 where sim2real needs MuJoCo 4: "
            f"they cannot share an environment. To train there, export the effects: "
            "sim2real export effects=PATH model=PATH.xml to=mjlab"
        )
    env = MJLabEnv(id, num_envs=num_envs, device=device)
    return TransformedEnv(env, RenameTransform(["actor"], ["observation"]))
