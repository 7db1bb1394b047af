"""The verdict for a terminal: a sentence, the gap, and a table of the values that were found.

sys.stdout.write(format_verdict(report, coloured=True))
"""

from collections.abc import Iterator, Sequence

from sim2real.diagnosis.report.text import (
    SUBTITLES,
    deviation_sentence,
    effect_display_name,
    format_place,
    interval,
    percent,
    place_of,
    quantity,
    verdict_sentence,
)
from sim2real.diagnosis.schema import Cause, Report

BOLD, RESET = "\033[1m", "\033[0m"
GREEN, YELLOW, RED = "\033[32m", "\033[33m", "\033[31m"
COLOURS = {
    "no_gap": GREEN,
    "explained": GREEN,
    "partly_explained": YELLOW,
    "fitted": YELLOW,
    "unexplained": RED,
}
HEAD = ("effect", "at", "value", "90 % interval", "confidence", "closes")
NUMBERS = (2, 4, 5)  # columns of numbers
GUTTER = 2  # spaces between columns
INDENT = "  "


def format_verdict(report: Report, coloured: bool = False) -> str:
    """Return a report's verdict as lines of text, the last one ended.

    `coloured` text has ANSI escape sequences that mark the verdict and the table's head.
    """
    bold, colour, reset = (BOLD, COLOURS[report.verdict], RESET) if coloured else ("", "", "")
    verdict = f"{bold}{colour}{SUBTITLES[report.verdict]}{reset}"
    lines = [f"{verdict}. {verdict_sentence(report)}", ""]
    lines += [INDENT + line for line in align(list(_gap(report)), right=(1,))]
    if report.values:
        head, *rows = align([HEAD, *_rows(report.values)], NUMBERS)
        lines += ["", *(INDENT + line for line in (f"{bold}{head}{reset}", *rows))]
    if report.deviations:
        lines += ["", deviation_sentence(report)]
    return "\n".join(lines) + "\n"


def align(rows: Sequence[Sequence[str]], right: Sequence[int] = ()) -> list[str]:
    """Return rows of cells as lines of aligned columns, those of `right` at their right ends."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    cells = [f"{{:{'>' if n in right else '<'}{width}}}" for n, width in enumerate(widths)]
    line = (" " * GUTTER).join(cells)
    return [line.format(*row).rstrip() for row in rows]


def _gap(report: Report) -> Iterator[tuple[str, str]]:
    gap = report.gap
    yield "gap", quantity(gap.before, gap.unit)
    if gap.after is not None and report.values:
        named = "these values" if report.fitted else "the causes"
        yield f"with {named}", quantity(gap.after, gap.unit, like=gap.before)
    yield "noise floor", quantity(gap.noise_floor, gap.unit, like=gap.before)


def _rows(causes: Sequence[Cause]) -> Iterator[tuple[str, ...]]:
    for cause in causes:
        effect, where = place_of(cause)
        yield (
            effect_display_name(effect) + (f" ({cause.side} side)" if cause.side else ""),
            where or "the robot",
            quantity(cause.value, cause.unit),
            interval(cause.value_ci, cause.unit, like=cause.value),
            percent(cause.confidence),
            percent(cause.closed),
        )
        for other in cause.equivalent:
            yield (
                f"  or {effect_display_name(other.effect)}",
                format_place(other.effect, other.where),
                *4 * "–",
            )
