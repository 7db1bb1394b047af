"""`compare.html`: the answer for a person, one file without scripts; all names are escaped."""

import math
from pathlib import Path
from typing import NamedTuple

from sim2real.diagnosis.comparison.answer import Alike, Change, Comparison, Fleet, Value
from sim2real.diagnosis.report.text import effect_display_name, format_place
from sim2real.runs.files import write_text
from sim2real.runs.pages import template

PAGE = Path(__file__).parent / "page" / "compare.html"
WORDS = {"unchanged": "Nothing changed.", "cannot_tell": "These logs cannot tell."}
SHOWN = 24  # effects whose intervals are drawn, the clearest first
REACH = 3.0  # half-widths of an interval that the picture shows at least
MIDDLE, HALF = 50.0, 47.0  # of the picture, and how far it reaches to either side


class Bar(NamedTuple):
    """An interval in the picture: places from 0 to 100, and whether it holds 0."""

    change: Change
    low: float
    middle: float
    high: float
    sure: bool


def write_page(answer: Comparison | Fleet, path: str | Path) -> Path:
    """Write the page of a comparison or a fleet."""
    fleet = isinstance(answer, Fleet)
    parts = answer.units if isinstance(answer, Fleet) else {"": answer}
    text = template(PAGE).render(
        fleet=fleet,
        shared=answer.mean if isinstance(answer, Fleet) else answer.shared,
        headline=headline(answer),
        parts=[(name, one, bars(one), headline(one)) for name, one in parts.items()],
        named=format_change,
    )
    return write_text(path, text)


def headline(answer: Comparison | Fleet) -> str:
    """Return the answer in a sentence."""
    if isinstance(answer, Fleet):
        odd = [name for name, one in answer.units.items() if one.verdict == "changed"]
        if odd:
            return f"{', '.join(odd)}: not like the others."
        return "No robot deviates." if answer.verdict == "unchanged" else WORDS["cannot_tell"]
    if answer.verdict == "changed":
        count = len(answer.changes)
        return f"Changed: {count} {'effect' if count == 1 else 'effects'}."
    return WORDS[answer.verdict]


def format_change(one: Change | Alike | Value) -> str:
    """Return an effect and its place in words."""
    return f"{effect_display_name(one.effect)} at {format_place(one.effect, one.where)}"


def bars(answer: Comparison) -> list[Bar]:
    """Return the intervals of what was watched, in half-widths, the clearest first."""
    half = {c: (c.interval[1] - c.interval[0]) / 2 for c in answer.watched}
    shown = [c for c in answer.watched if half[c] > 0]
    reach = max([REACH, *(abs(end) / half[c] for c in shown for end in c.interval)])
    found = []
    for change in shown:
        ends = [change.interval[0], change.change, change.interval[1]]
        low, middle, high = (_place(end / half[change], reach) for end in ends)
        found.append(Bar(change, low, middle, high, abs(change.change) > half[change]))
    return sorted(found, key=lambda bar: -abs(bar.middle - MIDDLE))[:SHOWN]


def _place(value: float, reach: float) -> float:
    """Return where a number of half-widths stands: logarithmic to either side."""
    return MIDDLE + HALF * math.copysign(math.log1p(abs(value)) / math.log1p(reach), value)
