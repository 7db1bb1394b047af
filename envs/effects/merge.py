"""Two lists of effects as one: what was known of a robot, and what was found on top of it.

    effects = combined(load_effects("known.yaml"), found)
    write_effects("effects.yaml", effects)            # a list that no effect is in twice

A gain that was known to be half and is found to be 0.8 of that is 0.4 of the model's.
"""

from collections.abc import Sequence

from envs.effects.base import Effect
from envs.effects.file import Values

Given = tuple[Effect, Sequence[float]]


def merge_effects(known: Sequence[Given], found: Sequence[Given]) -> list[tuple[Effect, Values]]:
    """Return the effects of both lists, those at one place added or multiplied.

    Args:
        known: effects with their values, no two at one place.
        found: effects with values on top of the known ones.

    Returns:
        The known effects in their order, then the found ones that are at other places. Two that
        neither add nor multiply both stay, and a plant refuses them.
    """
    effects = [(effect, tuple(values)) for effect, values in known]
    for effect, values in found:
        for number, (own, before) in enumerate(effects[: len(known)]):
            if _same(own, effect) and (both := _on_top(own, before, effect, values)):
                effects[number] = (own, both)
                break
        else:
            effects.append((effect, tuple(values)))
    return effects


def _same(one: Effect, other: Effect) -> bool:
    return (one.name, one.where, one.side) == (other.name, other.where, other.side)


def _on_top(own: Effect, before: Values, effect: Effect, values: Sequence[float]) -> Values | None:
    """Return the value of both, in the way of the first; None where there is none."""
    if not effect.composes or own.extra != effect.extra or own.free or effect.free:
        return None
    pairs = list(zip(before, values, strict=True))
    if effect.how == "add" and own.how in ("add", "set"):
        return tuple(a + b for a, b in pairs)
    if effect.how == "scale" and own.how in ("scale", "set"):
        return tuple(a * b for a, b in pairs)
    return None
