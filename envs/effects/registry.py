"""The one list of effects, by their standard names."""

from __future__ import annotations

from typing import Any, TypeVar

from envs.effects.base import Effect
from envs.errors import EffectError, did_you_mean

EFFECTS: dict[str, type[Effect]] = {}
E = TypeVar("E", bound=type[Effect])


def register(effect: E) -> E:
    """Add an effect class under its name, from where every verb knows it; returns the class.

    The same class defined anew, as a notebook's cell does, replaces the former one.

    Raises:
        EffectError: a class without a name, or one whose name another class has.
    """
    name = getattr(effect, "name", None)
    if not name:
        raise EffectError(f"{effect.__name__} has no name; give the class one: name = '...'")
    taken = EFFECTS.get(name, effect)
    if (taken.__module__, taken.__qualname__) != (effect.__module__, effect.__qualname__):
        raise EffectError(
            f"effect {name!r} is already {taken.__module__}.{taken.__qualname__};"
            " choose another name"
        )
    EFFECTS[name] = effect
    return effect


def make(name: str, **arguments: Any) -> Effect:
    """Return the effect of that standard name; raises EffectError with the nearest one if none."""
    if name not in EFFECTS:
        known = ", ".join(sorted(EFFECTS))
        raise EffectError(f"no effect {name!r}{did_you_mean(name, EFFECTS)}; there are: {known}")
    return EFFECTS[name](**arguments)
