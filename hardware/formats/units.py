"""Units that a mapping may name, and what they are in SI.

    factor("deg", "columns.yaml, qpos.elbow", "qpos")       # 0.0174…
    factor("counts/4096", place, "qpos")                    # of an encoder: 2π/4096

A unit has a dimension, and a column takes those of its kind: no speed is in seconds.
"""

import math
from collections.abc import Mapping, Sequence

from hardware.errors import LogError, did_you_mean, format_names

TURN = 2 * math.pi
PLAIN = "1"  # SI already, or a number without a dimension
COUNTS = "counts/"  # of an encoder; the number of counts in a turn follows
PER_SECOND = "/s"
ASKED = "?"  # in a mapping that was guessed: a person has to say
UNITS: Mapping[str, Mapping[str, float]] = {  # by dimension: factor to SI
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "angle": {"rad": 1.0, "deg": TURN / 360, "rev": TURN},
    "angular speed": {"rad/s": 1.0, "deg/s": TURN / 360, "rev/s": TURN, "rpm": TURN / 60},
    "length": {"m": 1.0, "mm": 1e-3},
    "speed": {"m/s": 1.0, "mm/s": 1e-3},
    "acceleration": {"m/s²": 1.0, "m/s^2": 1.0, "g": 9.80665},
    "current": {"A": 1.0, "mA": 1e-3},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "force": {"N": 1.0},
    "torque": {"N·m": 1.0, "Nm": 1.0},
    "temperature": {"°C": 1.0, "degC": 1.0},
    "number": {PLAIN: 1.0},
}
MOVES, PUSHES = ("angle", "length"), ("torque", "force")  # of a hinge, of a slide
SPEEDS = ("angular speed", "speed")
TAKES: Mapping[str, Sequence[str]] = {  # dimensions by kind of column; others take any
    "time": ("time",),
    "stamp": ("time",),
    "episode": ("number",),
    "qpos": MOVES,
    "qvel": SPEEDS,
    "qvel_des": SPEEDS,
    "ctrl": (*MOVES, *SPEEDS, *PUSHES),
    "torque_ff": PUSHES,
    "torque": ("number",),
    "flag": ("number",),
    "current": ("current",),
    "voltage": ("voltage",),
    "temperature": ("temperature",),
    "gyro": ("angular speed",),
    "accelerometer": ("acceleration",),
    "quat": ("number",),
}


def factor(unit: str, place: str, kind: str) -> float:
    """Return the factor from a unit to SI.

    Args:
        unit: the unit; `counts/4096` is an encoder's, with `/s` behind it a speed's.
        place: for the message: where it stands.
        kind: of the column, such as `qpos`.

    Raises:
        LogError: a unit that is not known, or of a dimension that the column has not.
    """
    dimension, size = _find(unit, place)
    allowed = TAKES.get(kind, ())
    if allowed and unit != PLAIN and dimension not in allowed:
        units = [name for other in allowed for name in UNITS[other]]
        raise LogError(
            f"{place}: {unit!r} is a unit of {dimension}, and `{kind}` is a column of "
            f"{' or '.join(allowed)}; its units are {format_names(units)}"
        )
    return size


def check_unit(unit: str, place: str, slide: bool) -> None:
    """Refuse a unit of a slide's motion for a hinge, and of a hinge's for a slide.

    Args:
        unit: the unit.
        place: for the message: the log, and the column.
        slide: whether the column's joint is a slide.

    Raises:
        LogError: with the units that are allowed.
    """
    dimension, _ = _find(unit, place)
    for pair in (MOVES, SPEEDS, PUSHES):
        if dimension == pair[not slide]:
            raise LogError(
                f"{place}: {unit!r} is a unit of {dimension}, but its joint is a "
                f"{'slide' if slide else 'hinge'}, which takes {format_names(UNITS[pair[slide]])}; "
                "correct `unit` in the mapping, or give the `scale` that converts it to SI"
            )


def _find(unit: str, place: str) -> tuple[str, float]:
    """Return a unit's dimension and its factor to SI."""
    if unit.startswith(COUNTS):
        number, slash, rest = unit.removeprefix(COUNTS).partition("/")
        if number.isdigit() and int(number) > 0 and slash + rest in ("", PER_SECOND):
            return ("angular speed" if slash else "angle"), TURN / int(number)
        raise LogError(f"{place}: {unit!r} does not give the counts per turn; write `{COUNTS}4096`")
    for dimension, units in UNITS.items():
        if unit in units:
            return dimension, units[unit]
    known = [name for units in UNITS.values() for name in units]
    if unit == ASKED:
        raise LogError(f"{place}: the unit is not filled in yet; available: {format_names(known)}")
    hint = did_you_mean(unit, known)
    if unit.strip() in ("%", "percent"):
        hint = "; a percentage of a range becomes rad by `scale`: half of the range over 100"
    raise LogError(
        f"{place}: the unit {unit!r} is not known{hint}; available: {format_names(known)} and "
        f"'{COUNTS}4096' (of an encoder with 4096 counts a turn)"
    )
