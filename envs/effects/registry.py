"""The one list of effects, by their standard names."""

import inspect
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from envs.effects.base import Effect
from envs.errors import EffectError, did_you_mean
from envs.physics.base import Engine

EFFECTS: dict[str, type[Effect]] = {}
E = TypeVar("E", bound=type[Effect])


def register(effect: E) -> E:
    """Add an effect class under its name, from where every verb knows it; returns the class.

    The same class defined again, as a notebook's cell does, replaces the former one.

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
        raise EffectError(
            f"no effect {name!r}{did_you_mean(name, EFFECTS)}; choose one of: {known}"
        )
    return EFFECTS[name](**arguments)


def named(entry: Mapping[str, Any], place: str, more: tuple[str, ...] = ()) -> Effect:
    """Return the effect of a mapping such as {effect: link_mass, where: torso, how: set}.

    Args:
        entry: the effect's standard name, and arguments of its class.
        place: where the mapping is, for messages.
        more: further keys that the mapping may have, for messages.

    Raises:
        EffectError: no name, or an argument that the effect does not have, with the nearest.
    """
    arguments = {str(key): value for key, value in entry.items()}
    name = arguments.pop("effect", None)
    if not isinstance(name, str):
        raise EffectError(
            f"{place}: effect={name!r} must be the standard name of an effect, such as link_mass"
        )
    where = arguments.get("where")
    if not isinstance(where, str | None):
        raise EffectError(f"{place}: where={where!r} must be a name of the model, or null")
    known = (*_arguments(EFFECTS[name]), *more) if name in EFFECTS else ()
    try:
        wrong = [key for key in arguments if known and key not in known]
        if wrong:
            hint = did_you_mean(wrong[0], known)
            raise EffectError(f"{name} has no {wrong[0]!r}{hint}; it has: {', '.join(known)}")
        return make(name, **arguments)
    except (EffectError, TypeError) as error:
        raise EffectError(f"{place}: {error}") from None


def _arguments(effect: type[Effect]) -> list[str]:
    """Return the names of an effect's arguments, its extras among them."""
    kinds = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
    own = [inspect.signature(made.__init__).parameters.values() for made in (Effect, effect)]
    names = [p.name for p in [*own[0], *own[1]] if p.kind not in kinds and p.name != "self"]
    return list(dict.fromkeys([*names, *(extra.name for extra in effect.extras)]))


def refuse_elsewhere(effects: Iterable[Effect], engine: Engine) -> None:
    """Raise EffectError, with those that work, for an effect that an engine does not have."""
    for effect in effects:
        if engine not in effect.engines:
            there = sorted(name for name, one in EFFECTS.items() if engine in one.engines)
            variant = f" ({effect.variant})" if effect.variant else ""
            raise EffectError(
                f"{effect.label()}{variant} does not work with physics={engine}; leave it out, or "
                f"use physics={effect.engines[0]}. Available with physics={engine}: "
                f"{', '.join(there)}"
            )
