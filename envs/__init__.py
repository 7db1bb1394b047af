"""Simulated worlds: tasks, the batched simulator, and the parameter space that describes robots.

    from envs import Draw, Hopper, MujocoEnv, Randomization, RandomizeParams, make
    from torchrl.envs import TransformedEnv

    tasks = Randomization([Draw(make("link_mass", where="torso", how="set"), low=1.0, high=9.0)])
    env = TransformedEnv(MujocoEnv(Hopper(), 256, tasks.effects), RandomizeParams(tasks))

A name's module is imported when the name is first used: only the TorchRL environments import torch.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from envs.effects import EFFECTS, Effect, make, register
    from envs.errors import EffectError, EnvsError, ParameterError, TaskError
    from envs.mujoco import MujocoEnv
    from envs.params import Parameter, ParamSpace
    from envs.plant import Plant
    from envs.randomization import Draw, Randomization, Tasks
    from envs.rows import Rows, Step
    from envs.simulation import Simulation
    from envs.tasks import (
        Ant,
        Bench1,
        Follow,
        HalfCheetah,
        Hopper,
        Hopper2,
        HopperPolito,
        InvertedPendulum,
        Quad8,
        Quad12,
        ServoTask,
        State,
        Swimmer,
        Task,
        Walker2d,
    )
    from envs.torch_env import RandomizeParams, RowsEnv

__all__ = [
    "EFFECTS",
    "Ant",
    "Bench1",
    "Draw",
    "Effect",
    "EffectError",
    "EnvsError",
    "Follow",
    "HalfCheetah",
    "Hopper",
    "Hopper2",
    "HopperPolito",
    "InvertedPendulum",
    "MujocoEnv",
    "ParamSpace",
    "Parameter",
    "ParameterError",
    "Plant",
    "Quad8",
    "Quad12",
    "Randomization",
    "RandomizeParams",
    "Rows",
    "RowsEnv",
    "ServoTask",
    "Simulation",
    "State",
    "Step",
    "Swimmer",
    "Task",
    "TaskError",
    "Tasks",
    "Walker2d",
    "make",
    "register",
]

_MODULES = {
    "effects": ("EFFECTS", "Effect", "make", "register"),
    "errors": ("EffectError", "EnvsError", "ParameterError", "TaskError"),
    "mujoco": ("MujocoEnv",),
    "params": ("ParamSpace", "Parameter"),
    "plant": ("Plant",),
    "randomization": ("Draw", "Randomization", "Tasks"),
    "rows": ("Rows", "Step"),
    "simulation": ("Simulation",),
    "torch_env": ("RandomizeParams", "RowsEnv"),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name's module on its first use."""
    if name not in __all__:
        raise AttributeError(f"module 'envs' has no attribute {name!r}")
    return getattr(import_module(f"envs.{_HOME.get(name, 'tasks')}"), name)


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted(__all__)
