"""Randomization around what the model says: each parameter times a factor near 1.

    masses = [make("link_mass", where=body, how="scale") for body in ("thigh", "leg", "foot")]
    tasks = uniform(masses, width=0.075)        # factors U[0.925, 1.075], a new draw each episode
    tasks = normal(masses, std=0.1)             # factors N(1, 0.1)

One number, the width or the deviation, is then all that a sweep over the strength of the
randomization changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from envs.effects.base import Effect
from envs.errors import ParameterError
from envs.randomization import Draw, Randomization

Per = Literal["reset", "row"]


def uniform(effects: Sequence[Effect], width: float, per: Per = "reset") -> Randomization:
    """Return independent factors, uniform within `width` of 1.

    Args:
        effects: what is scaled, each with how="scale".
        width: half the range of the factors; 0 leaves the model as it is.
        per: "reset" draws anew for each episode, "row" once for each row.

    Raises:
        ParameterError: a width below 0, or so large that a factor could be 0 or negative, as no
            mass is; an effect that does not scale.
    """
    if not 0 <= width < 1:
        raise ParameterError(
            f"params.width={width:g} draws factors from {1 - width:g} to {1 + width:g}; "
            "no mass is 0 or negative: give a width from 0 to below 1"
        )
    _check(effects)
    return Randomization([Draw(e, "uniform", low=1 - width, high=1 + width) for e in effects], per)


def normal(effects: Sequence[Effect], std: float, per: Per = "reset") -> Randomization:
    """Return independent factors of mean 1, normal.

    Args:
        effects: what is scaled, each with how="scale".
        std: standard deviation of the factors.
        per: "reset" draws anew for each episode, "row" once for each row.

    Raises:
        ParameterError: a deviation that is not positive; an effect that does not scale.
    """
    _check(effects)
    return Randomization([Draw(effect, "normal", mean=1.0, std=std) for effect in effects], per)


def _check(effects: Sequence[Effect]) -> None:
    for effect in effects:
        if effect.how != "scale":
            raise ParameterError(
                f"params: {effect.label()} has how={effect.how}, but factors scale; set how: scale"
            )
