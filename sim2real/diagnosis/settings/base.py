"""How a setting is declared, and how all of them are listed.

    @dataclass(frozen=True)
    class Lag:
        window_s: float = setting(3.0, "length of a window", JUDGED)

    for row in rows(Settings()): row.stage, row.name, row.value, row.unit, row.meaning, row.origin

A setting is a number that an answer depends on. Its name says what it limits and in which unit; its
origin says where the value comes from. "rad" stands for rad at hinges and m at slides.
"""

from collections.abc import Iterator
from dataclasses import field, fields
from typing import Any, NamedTuple

# Origins that many settings share.
DEVELOPED = (
    "set by hand during development, with the cases of exam seeds 2026 and 2027 at hand"
    " (benchmarks/notebook/exam.md); not studied one by one"
)
JUDGED = "judgement; not studied"
COST = "computing time: a finer value changes the answer little and costs more"
ROUNDING = "derived: keeps a singular system solvable, far below what data say"

# Endings of names, and the units that they stand for; of two that fit, the longer one is first.
ENDINGS = {"_rad_s": "rad/s", "_m_s2": "m/s²", "_m_s": "m/s", "_s": "s"}
ENDINGS |= {"_m": "m", "_rad": "rad", "_hz": "Hz"}

TINY = 1e-9  # rad, m, s or a share: keeps quotients finite and is far below anything measured
TINY_SQUARE = TINY**2


class Row(NamedTuple):
    """One setting, as the report's table shows it."""

    stage: str
    name: str
    value: Any
    unit: str
    meaning: str
    origin: str


def setting(default: Any, meaning: str, origin: str, *, unit: str | None = None) -> Any:
    """Return a field of a settings class.

    Args:
        default: its value.
        meaning: what it limits, as a phrase.
        origin: where the value comes from: derived, a reference, or the cases it was tuned on.
        unit: SI; None: the one that the name ends with, else "1" for a share, factor or count.
    """
    return field(default=default, metadata={"unit": unit, "meaning": meaning, "origin": origin})


def rows(settings: Any) -> Iterator[Row]:
    """Yield every setting of every stage, in the order of the classes."""
    for stage in fields(settings):
        yield from rows_of(stage.name, getattr(settings, stage.name))


def rows_of(stage: str, group: Any) -> Iterator[Row]:
    """Yield every setting of one stage."""
    for one in fields(group):
        unit, meaning, origin = (one.metadata[key] for key in ("unit", "meaning", "origin"))
        if unit is None:
            unit = next((own for end, own in ENDINGS.items() if one.name.endswith(end)), "1")
        yield Row(stage, one.name, getattr(group, one.name), unit, meaning, origin)
