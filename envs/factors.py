"""Randomization around what the model says: each parameter times a factor near 1.

    masses = [make("link_mass", where=body, how="scale") for body in ("thigh", "leg", "foot")]
    tasks = uniform(masses, width=0.075)        # factors U[0.925, 1.075], a new draw each episode
    tasks = normal(masses, std=0.1)             # factors N(1, 0.1)

One number, the width or the deviation, is then all that a sweep over the strength of the
randomization changes.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from envs.effects.base import Effect
from envs.effects.registry import named
from envs.errors import ParameterError
from envs.randomization import Draw, Randomization

Per = Literal["reset", "row"]


def uniform(
    effects: Sequence[Effect | Mapping[str, Any]], width: float, per: Per = "reset"
) -> Randomization:
    """Return independent factors, uniform within `width` of 1.

    Args:
        effects: what is scaled, each with how="scale", or mappings of names as in YAML.
        width: half the range of the factors; 0 leaves the model as it is.
        per: "reset" draws for each episode, "row" once for each row.

    Raises:
        ParameterError: a width below 0, or so large that a factor could be 0 or negative, as no
            mass is; an effect that does not scale.
    """
    if not 0 <= width < 1:
        raise ParameterError(
            f"params.width={width:g} draws factors from {1 - width:g} to {1 + width:g}; "
            "no mass is 0 or negative: give a width from 0 to below 1"
        )
    low, high = 1 - width, 1 + width
    return Randomization([Draw(e, "uniform", low=low, high=high) for e in _scaling(effects)], per)


def normal(
    effects: Sequence[Effect | Mapping[str, Any]], std: float, per: Per = "reset"
) -> Randomization:
    """Return independent factors of mean 1, normal.

    Args:
        effects: what is scaled, each with how="scale", or mappings of names as in YAML.
        std: standard deviation of the factors.
        per: "reset" draws for each episode, "row" once for each row.

    Raises:
        ParameterError: a deviation that is not positive; an effect that does not scale.
    """
    return Randomization([Draw(e, "normal", mean=1.0, std=std) for e in _scaling(effects)], per)


def _scaling(effects: Sequence[Effect | Mapping[str, Any]]) -> list[Effect]:
    found = [
        effect if isinstance(effect, Effect) else named(effect, f"params.effects[{number}]")
        for number, effect in enumerate(effects)
    ]
    for effect in found:
        if effect.how != "scale":
            raise ParameterError(
                f"params: {effect.label()} has how={effect.how}, but factors scale; set how: scale"
            )
    return found
