"""A policy works in simulation and fails on the robot: find out why; train one that transfers.

    from sim2real import compose, diagnose, load_policy, make_env

    report = diagnose("log.csv", "arm.xml")
    report.verdict, report.causes, report.gap

    env = make_env(compose(["+experiment=udr"]), num_envs=256)  # a TorchRL environment
    action = load_policy("outputs/train/udr/TIME").controller()(observation)

A name's module is imported when the name is first used: `import sim2real` alone costs nothing.
"""

from __future__ import annotations

import warnings
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sim2real.config.compose import compose
    from sim2real.deployment.trained import load_policy
    from sim2real.diagnosis.diagnose import diagnose
    from sim2real.diagnosis.schema import Report
    from sim2real.learning.adapt import GradientAdaptation, HillClimb, NoAdaptation, Session
    from sim2real.learning.environment import make_env
    from sim2real.learning.trained import TrainedPolicy
    from sim2real.runs.errors import Sim2RealError

__all__ = [
    "GradientAdaptation",
    "HillClimb",
    "NoAdaptation",
    "Report",
    "Session",
    "Sim2RealError",
    "TrainedPolicy",
    "compose",
    "diagnose",
    "load_policy",
    "make_env",
]

_MODULES = {
    "config.compose": ("compose",),
    "deployment.trained": ("load_policy",),
    "diagnosis.diagnose": ("diagnose",),
    "diagnosis.schema": ("Report",),
    "learning.adapt": ("GradientAdaptation", "HillClimb", "NoAdaptation", "Session"),
    "learning.environment": ("make_env",),
    "learning.trained": ("TrainedPolicy",),
    "runs.errors": ("Sim2RealError",),
}
_RENAMED = {"Trained": "TrainedPolicy"}
_HOME = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name's module on its first use."""
    if name in _RENAMED:
        message = f"sim2real.{name} is now sim2real.{_RENAMED[name]}; the old name goes in 0.3"
        warnings.warn(message, DeprecationWarning, stacklevel=2)
        name = _RENAMED[name]
    if name not in _HOME:
        raise AttributeError(f"module 'sim2real' has no attribute {name!r}")
    return getattr(import_module(f"sim2real.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    """Return the public names."""
    return sorted(__all__)
