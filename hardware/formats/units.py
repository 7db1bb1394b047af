"""Units that a mapping may name, and what they are in SI."""

from __future__ import annotations

import math

from hardware.errors import LogError, did_you_mean, format_names

UNITS = {  # factor to SI
    "rad": 1.0,
    "deg": math.pi / 180,
    "rev": 2 * math.pi,
    "rad/s": 1.0,
    "deg/s": math.pi / 180,
    "rpm": 2 * math.pi / 60,
    "m": 1.0,
    "mm": 1e-3,
    "m/s": 1.0,
    "mm/s": 1e-3,
    "s": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "ns": 1e-9,
    "A": 1.0,
    "mA": 1e-3,
    "V": 1.0,
    "mV": 1e-3,
    "N": 1.0,
    "N·m": 1.0,
    "Nm": 1.0,
    "°C": 1.0,
    "degC": 1.0,
    "1": 1.0,
}


def factor(unit: str, place: str) -> float:
    """Return what a number in a unit is multiplied by to be in SI.

    Raises:
        LogError: a unit that is not known, with those that are.
    """
    if unit not in UNITS:
        raise LogError(
            f"{place}: the unit {unit!r} is not known{did_you_mean(unit, UNITS)}; "
            f"there are {format_names(UNITS)}"
        )
    return UNITS[unit]
