"""Checks of algorithms' settings, with a sentence for each violation."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, NamedTuple

import torch
from tensordict import TensorDictBase

from sim2real.runs.errors import CheckpointError, Sim2RealError


class Range(NamedTuple):
    """What a number must be, in words and as a test."""

    words: str
    holds: Callable[[float], bool]


FRACTION = Range("between 0 and 1", lambda value: 0 <= value <= 1)
POSITIVE = Range("above 0", lambda value: value > 0)
NOT_NEGATIVE = Range("at least 0", lambda value: value >= 0)
RANGES = {  # of arguments of an algorithm's parts, which TorchRL and torch do not check
    "advantage.gamma": FRACTION,
    "advantage.lmbda": FRACTION,
    "loss.clip_epsilon": POSITIVE,
    "loss.critic_coeff": NOT_NEGATIVE,
    "loss.entropy_coeff": NOT_NEGATIVE,
    "loss.alpha_init": POSITIVE,
    "optimizer.lr": POSITIVE,
}


def check_part(name: str, part: Any, place: str = "") -> None:
    """Raise Sim2RealError for a number of a part, or of one within it, that is out of `RANGES`.

    Args:
        name: of the part, such as "loss".
        part: what makes it; only a `functools.partial` holds numbers.
        place: where it is in a configuration; "": the name.
    """
    for key, value in part.keywords.items() if isinstance(part, partial) else ():
        check_part(name, value, f"{place or name}.{key}")
        if f"{name}.{key}" in RANGES and isinstance(value, int | float):
            _check(RANGES[f"{name}.{key}"], f"{place or name}.{key}", value)


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
        _check(Range(f"at least {least}", lambda value: value >= least), f"algorithm.{name}", value)


def check_fraction(**shares: float) -> None:
    """Raise Sim2RealError for options that are not between 0 and 1."""
    for name, value in shares.items():
        _check(FRACTION, f"algorithm.{name}", value)


def check_positive(**numbers: float | None) -> None:
    """Raise Sim2RealError for options that are not above 0; None is none."""
    for name, value in numbers.items():
        if value is not None:
            _check(POSITIVE, f"algorithm.{name}", value)


def _check(allowed: Range, place: str, value: float) -> None:
    if not allowed.holds(value):
        raise Sim2RealError(f"{place}={value} must be {allowed.words}")


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
