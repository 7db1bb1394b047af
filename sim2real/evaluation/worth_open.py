"""Effects that the logs do not exclude, at the ends of their intervals.

    excluded_of(facts, causes)          # causes of report.json or compare.json to be priced

A diagnosis leaves each cause an interval, and effects that explain as much (its equivalents); a
comparison leaves one for every effect that it watched. Each end is something that the robot may
still have.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from envs.effects import Effect, make
from envs.errors import EnvsError
from sim2real.evaluation.cause_costs import Cause

OPEN_MAX = 24  # effects that are played at most, those with the widest intervals first


def interval_endpoints(facts: Mapping[str, Any], causes: Sequence[Cause]) -> list[Cause]:
    """Return effects at the ends of their intervals.

    Args:
        facts: of a report.json or a compare.json.
        causes: what is known; their own intervals count where the facts have none.
    """
    found = [end for cause in causes for end in _of_cause(cause)]
    taken = {cause.label for cause in causes}
    for watched in facts.get("watched", []):
        low, high = watched["interval"]
        effect = _made(watched)
        if effect is None or _with(effect, 0.0).label in taken:
            continue
        neutral = 1.0 if effect.how == "scale" else 0.0
        ends = [end for end in (low, high) if abs(end) > 0]
        found += [_with(effect, neutral + end) for end in ends]
    return found[:OPEN_MAX]


def _of_cause(cause: Cause) -> list[Cause]:
    """Return a cause at both ends of its interval."""
    if cause.ci is None:
        return []
    return [replace(cause, values=(end, *cause.values[1:]), std=0.0, ci=None) for end in cause.ci]


def _with(effect: Effect, value: float) -> Cause:
    return Cause(effect, (value,))


def _made(watched: Mapping[str, Any]) -> Effect | None:
    """Return the effect of a compared one; None where it cannot be made by its name and place."""
    side = {} if watched.get("side") is None else {"side": watched["side"]}
    try:
        return make(watched["effect"], where=watched.get("body") or watched.get("where"), **side)
    except (EnvsError, TypeError):
        return None
