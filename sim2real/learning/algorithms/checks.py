"""Checks of algorithms' settings, with a sentence for each violation."""

from collections.abc import Iterable, Mapping
from typing import Any

import torch
from tensordict import TensorDictBase

from sim2real.runs.errors import CheckpointError, Sim2RealError


def check_same_policy(there: Mapping[str, Any], here: Mapping[str, Any]) -> None:
    """Raise CheckpointError where a checkpoint's policy has another shape than this run's."""
    if dict(there) != dict(here):
        raise CheckpointError(
            f"checkpoint: its policy is {dict(there)}, this run's is {dict(here)}; give the run "
            "the checkpoint's env and policy"
        )


def check_loss(loss: Any, data: TensorDictBase) -> None:
    """Raise Sim2RealError for an entry that a loss reads and experience does not hold."""
    there = set(data.keys(True, True))
    for key in loss.in_keys:
        if key not in there and (isinstance(key, str) or key[0] != "next"):
            names = sorted(k for k in there if isinstance(k, str))
            raise Sim2RealError(
                f"loss: {type(loss).__name__} reads {key!r}, which is missing; available: "
                f"{', '.join(names)}"
            )


def check_at_least(least: int, **counts: int) -> None:
    """Raise Sim2RealError for options below what they must be."""
    for name, value in counts.items():
        if value < least:
            raise Sim2RealError(f"algorithm.{name}={value} must be at least {least}")


def check_fraction(**shares: float) -> None:
    """Raise Sim2RealError for options that are not between 0 and 1."""
    for name, value in shares.items():
        if not 0 <= value <= 1:
            raise Sim2RealError(f"algorithm.{name}={value} must be between 0 and 1")


def check_finite(parameters: Iterable[torch.Tensor], iteration: int, lower: str) -> None:
    """Raise Sim2RealError for parameters that are no longer finite.

    Args:
        parameters: of the policy.
        iteration: after which they are looked at.
        lower: the options that a person should lower.
    """
    if not all(torch.isfinite(p).all() for p in parameters):
        raise Sim2RealError(
            f"the policy's parameters are no longer finite after iteration {iteration}; lower "
            f"{lower}, or look for rewards that are not finite; the previous checkpoint is intact"
        )
