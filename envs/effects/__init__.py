"""The effects that every verb knows, by their standard names.

    effect = make("link_mass", where="torso", how="set")

`EFFECTS` maps the names of the vocabulary to classes; `register` adds one of the user's own.
"""

from __future__ import annotations

from typing import Any

from envs.effects.base import Bound, Effect, FieldEffect, Measurement, SubstepRule
from envs.effects.contact import GroundFriction
from envs.effects.inertia import LinkMass
from envs.errors import EffectError, did_you_mean

EFFECTS: dict[str, type[Effect]] = {}


def register(effect: type[Effect]) -> type[Effect]:
    """Add an effect class under its name; raises EffectError if the name is taken by another class."""
    if EFFECTS.setdefault(effect.name, effect) is not effect:
        raise EffectError(f"effect {effect.name!r} is already {EFFECTS[effect.name].__name__}; choose another name")
    return effect


def make(name: str, **arguments: Any) -> Effect:
    """Return the effect of that standard name; raises EffectError with the nearest name if there is none."""
    if name not in EFFECTS:
        known = ", ".join(sorted(EFFECTS))
        raise EffectError(f"no effect {name!r}{did_you_mean(name, EFFECTS)}; there are: {known}")
    return EFFECTS[name](**arguments)


for _effect in (LinkMass, GroundFriction):
    register(_effect)

__all__ = ["EFFECTS", "Bound", "Effect", "FieldEffect", "Measurement", "SubstepRule", "make", "register"]
