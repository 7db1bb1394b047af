"""Tables of a YAML file against the fields of a dataclass: names, plain types, what is missing.

typed_fields(Supply, {"voltage": 5, "resistance": 0.0}, "bench1.yaml: supply")
"""

import math
import types
import typing
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any

from hardware.errors import RobotError, did_you_mean, format_names

AMOUNT = {2: "a pair of"}


def mapping(value: Any, place: str) -> Mapping[str, Any]:
    """Return a table; raises RobotError if it is none."""
    if not isinstance(value, Mapping):
        raise RobotError(f"{place}: {value!r} is not a table of names and values")
    return value


def parse_fields(cls: type, data: Any, place: str) -> dict[str, Any]:
    """Check names and plain types of a table against the fields of a dataclass.

    Raises:
        RobotError: an unknown or missing key, or a value of another type; with its place.
    """
    data = mapping(data, place)
    hints = typing.get_type_hints(cls)
    for key in data:
        if key not in hints:
            hint = did_you_mean(str(key), hints)
            raise RobotError(
                f"{place}: unknown key {key!r}{hint}; it can have {format_names(hints)}"
            )
    for item in fields(cls):
        needed = item.default is MISSING and item.default_factory is MISSING
        if needed and item.name not in data:
            raise RobotError(f"{place}: the key {item.name!r} is missing")
    return {key: _typed(value, hints[key], f"{place}: {key}") for key, value in data.items()}


def _typed(value: Any, wanted: Any, place: str) -> Any:
    """Return the value as the wanted plain type; raise RobotError if it cannot be that."""
    options = typing.get_args(wanted) if isinstance(wanted, types.UnionType) else (wanted,)
    if value is None and types.NoneType in options:
        return None
    if float in options and isinstance(value, int | float) and not isinstance(value, bool):
        if not math.isfinite(value):
            raise RobotError(f"{place}: {value} is not a finite number")
        return float(value)
    if int in options and isinstance(value, int) and not isinstance(value, bool):
        return value
    if str in options and isinstance(value, str):
        return value
    if typing.get_origin(wanted) is tuple and set(typing.get_args(wanted)) == {float}:
        size = len(typing.get_args(wanted))
        if not isinstance(value, list | tuple) or len(value) != size:
            raise RobotError(f"{place}: {value!r} is not {AMOUNT.get(size, size)} numbers")
        return tuple(_typed(part, float, place) for part in value)
    if {int, float, str}.isdisjoint(options):
        return value
    names = " or ".join("null" if o is types.NoneType else o.__name__ for o in options)
    raise RobotError(f"{place}: {value!r} is not {names}")
