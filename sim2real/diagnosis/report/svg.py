"""Pictures of a report as inline SVG: sharp at every width, readable in print, no script needed.

    picture = window(trace, Span(3.0, 6.0))         # measured, simulated before and after
    picture = track(0.2, 0.3, [(0.25, "after")])    # an interval and a dot on a line from 0 to 1

Every text that comes from outside is escaped. Colours are those of Okabe and Ito, and lines differ
in their dashes too.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from sim2real.diagnosis.evidence import Trace
from sim2real.diagnosis.report.axes import Linear, Signed
from sim2real.diagnosis.settings import TINY

WIDTH, TOP, MAIN, GAP, ERROR, LEFT, BOTTOM = 330, 6, 118, 14, 56, 52, 22  # of a window, units
EDGE = 6  # right of a window, units
SPREAD = 1e4  # between the largest error and that from which on the axis is linear, at most
POINTS = 700  # of a line, at most
FULL = 0.6  # of the most compared rows in any piece, that a piece must hold to be shown
MILLI = 1e-3
SPARE, BANDS = 1.08, 2.5  # height of the error plot: of the largest error, and in noise floors
ROOM = 0.05  # above and below the positions, of their range
NEAR = 0.04  # share of a scale's length from its ends, at which its numbers stand inside it
TICKS, FEW_TICKS, TALL = 4, 3, 100  # numbers on an axis; on one that is less tall, units
BENT = 12.0  # largest error, in twice the noise floor, from which the error axis is logarithmic
NUMBER, UNIT, TIME, LAST = 5, 11, 14, 9  # distances of numbers and of the last one, units
LEAST = 1e-6  # rad or m: room above and below positions that do not change
LINES = ("measured", "nominal", "corrected")  # drawn in this order


class Span(NamedTuple):
    """A piece of a trace, in seconds."""

    start: float
    end: float


def spans(trace: Trace, seconds: float) -> list[Span]:
    """Return half overlapping pieces of a trace that hold many rows which are compared."""
    time, known = trace.time, compared(trace)
    if time[-1] - time[0] <= seconds:
        return [Span(float(time[0]), float(time[-1]))] if known.any() else []
    starts = np.arange(time[0], time[-1] - seconds, seconds / 2)
    every = [Span(float(s), float(s + seconds)) for s in starts]
    counts = [int(known[rows(trace, span)].sum()) for span in every]
    return [s for s, n in zip(every, counts, strict=True) if n > 0 and n >= FULL * max(counts)]


def rows(trace: Trace, span: Span) -> np.ndarray:
    """Return which rows of a trace lie in a piece of it, (T,) bool."""
    return (trace.time >= span.start) & (trace.time <= span.end)


def compared(trace: Trace) -> np.ndarray:
    """Return which rows of a trace the simulation is compared with, (T,) bool."""
    return np.isfinite(trace.nominal)


def error(trace: Trace, line: str, span: Span) -> float:
    """Return the root mean square of a simulation's error over the compared rows of a piece."""
    chosen = rows(trace, span) & compared(trace)
    return float(np.sqrt(np.mean((getattr(trace, line) - trace.measured)[chosen] ** 2)))


def lines(trace: Trace) -> tuple[str, ...]:
    """Return what is drawn: without causes there is no corrected line."""
    same = np.array_equal(trace.nominal, trace.corrected, equal_nan=True)
    return LINES[:2] if same else LINES


def window(trace: Trace, span: Span, title: str) -> Markup:
    """Draw a piece of a trace: positions above, errors below with the noise floor as a band.

    Args:
        trace: one joint of one episode.
        span: the piece.
        title: what a screen reader says.
    """
    inside = rows(trace, span)
    stride = max(1, math.ceil(inside.sum() / POINTS))
    index = np.flatnonzero(inside)[::stride]
    time, floor = trace.time[index], trace.floor
    scale = 1 / MILLI if trace.unit in ("rad", "m") else 1.0
    names = lines(trace)
    values = {line: getattr(trace, line)[index] for line in names}
    errors = {line: scale * (values[line] - values["measured"]) for line in names[1:]}
    x = Linear(span.start, span.end, LEFT, WIDTH - EDGE)
    upper = Linear(*_limits([*values.values()]), TOP + MAIN, TOP)
    base = TOP + MAIN + GAP
    lower = _errors([*errors.values()], 2 * floor * scale, base)
    runs = _runs(trace, index)
    parts = [_restarts(trace, span, x, base + ERROR)]
    parts += [_frame(x, upper, labels=False), _frame(x, lower, labels=True)]
    flat = np.full(2, 2 * floor * scale)
    parts.append(_band(x(np.array(span)), lower(-flat), lower(flat)))
    parts.append(_line(x(time), upper(values["measured"]), "measured"))
    for line in names[1:]:
        parts += [_line(x(time[run]), upper(values[line][run]), line) for run in runs]
        parts += [_line(x(time[run]), lower(errors[line][run]), line) for run in runs]
    unit = trace.unit
    small = f"error, m{unit}" if scale != 1 else f"error, {unit}"
    parts.append(_upright(TOP + MAIN / 2, unit))
    parts.append(_upright(base + ERROR / 2, small))
    height = base + ERROR + BOTTOM
    return _svg(WIDTH, height, title, parts)


def _errors(errors: Sequence[np.ndarray], floor: float, base: float) -> Linear | Signed:
    """Return an axis for errors, logarithmic where the largest is far above the noise."""
    most = SPARE * max(max(float(np.nanmax(np.abs(e))) for e in errors), BANDS / 2 * floor, TINY)
    if floor > 0 and most > BENT * floor:
        return Signed(max(floor, most / SPREAD), most, base + ERROR, base)
    return Linear(-most, most, base + ERROR, base)


def _runs(trace: Trace, index: np.ndarray) -> list[np.ndarray]:
    """Return the stretches of rows, as places in `index`, through which a simulation runs on."""
    known = compared(trace)[index]
    number = np.searchsorted(trace.starts, index, side="right")
    breaks = np.flatnonzero((np.diff(number) != 0) | (np.diff(known.astype(int)) != 0)) + 1
    runs = np.split(np.arange(len(index)), breaks)
    return [run for run in runs if len(run) and known[run[0]]]


def _restarts(trace: Trace, span: Span, x: Linear, bottom: float) -> Markup:
    """Mark where the simulation starts again from the measured state."""
    times = trace.time[trace.starts]
    line = Markup('<path class="restart" d="M{:.1f} {}V{}"/>')
    return Markup("").join(
        line.format(float(x(t)), TOP, bottom) for t in times if span.start < t < span.end
    )


def _limits(values: Sequence[np.ndarray]) -> tuple[float, float]:
    low = min(float(np.nanmin(v)) for v in values)
    high = max(float(np.nanmax(v)) for v in values)
    room = max(ROOM * (high - low), LEAST)
    return low - room, high + room


def _frame(x: Linear, y: Linear | Signed, labels: bool) -> Markup:
    """Draw grid lines and numbers; those of time below the lower plot only."""
    out = []
    for value, text in y.ticks(TICKS if y.start - y.end > TALL else FEW_TICKS):
        at = float(y(value))
        out.append(Markup('<path class="grid" d="M{} {:.1f}H{}"/>').format(x.start, at, x.end))
        out.append(
            Markup('<text class="n" x="{}" y="{:.1f}">{}</text>').format(LEFT - NUMBER, at, text)
        )
    for value, text in x.ticks(TICKS):
        at = float(x(value))
        out.append(Markup('<path class="grid" d="M{:.1f} {}V{}"/>').format(at, y.start, y.end))
        if labels:
            low = y.start + TIME
            at = min(at, x.end - LAST)
            out.append(
                Markup('<text class="t" x="{:.1f}" y="{}">{} s</text>').format(at, low, text)
            )
    return Markup("").join(out)


def _line(x: np.ndarray, y: np.ndarray, kind: str) -> Markup:
    return Markup('<path class="{}" d="M{}"/>').format(kind, _points(x, y))


def _band(x: np.ndarray, low: np.ndarray, high: np.ndarray) -> Markup:
    there, back = _points(x, low), _points(x[::-1], high[::-1])
    return Markup('<path class="band" d="M{}L{}Z"/>').format(there, back)


def _points(x: np.ndarray, y: np.ndarray) -> str:
    return "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))


def _upright(y: float, text: str) -> Markup:
    upright = Markup('<text class="u" transform="translate({} {:.1f}) rotate(-90)">{}</text>')
    return upright.format(UNIT, y, text)


def _svg(width: float, height: float, title: str, parts: Sequence[Markup]) -> Markup:
    head = Markup('<svg class="plot" viewBox="0 0 {} {}" role="img" aria-label="{}">')
    return head.format(width, height, title) + Markup("").join(parts) + Markup("</svg>")


def track(
    low: float | None,
    high: float | None,
    dots: Sequence[tuple[float, str]],
    floor: float = 0.0,
    ticks: Sequence[float] = (),
) -> Markup:
    """Draw an interval and dots on a line; all numbers are shares of its length.

    Args:
        low: start of the interval; None where there is none.
        high: its end.
        dots: values, each with its class of colours: before, after, step or floor. The first one's
            is the interval's too.
        floor: what is shaded from the left on.
        ticks: where thin lines stand.
    """
    out = [Markup('<svg class="track" height="22" role="presentation">')]
    if floor > 0:
        shade = Markup('<rect class="shade" x="0" y="0" width="{}" height="22"/>')
        out.append(shade.format(_part(floor)))
    for tick in ticks:
        line = Markup('<line class="tick" x1="{0}" x2="{0}" y1="0" y2="22"/>')
        out.append(line.format(_part(tick)))
    if low is not None and high is not None:
        bar = Markup('<line class="bar {}" x1="{}" x2="{}" y1="11" y2="11"/>')
        out.append(bar.format(dots[0][1], _part(low), _part(high)))
    circle = Markup('<circle class="dot {}" cx="{}" cy="11" r="5"/>')
    out += [circle.format(kind, _part(at)) for at, kind in dots]
    return Markup("").join([*out, Markup("</svg>")])


def numbers(ticks: Sequence[tuple[float, str]]) -> Markup:
    """Draw the numbers of a scale: shares of its length, with their text."""
    text = Markup('<text x="{}" y="12" text-anchor="{}">{}</text>')
    out = []
    for at, said in ticks:
        side = "start" if at < NEAR else "end" if at > 1 - NEAR else "middle"
        out.append(text.format(_part(at), side, said))
    head = Markup('<svg class="numbers" height="16" role="presentation">')
    return Markup("").join([head, *out, Markup("</svg>")])


def fill(share: float, kind: str) -> Markup:
    """Draw a bar from 0 to a share of the width."""
    bar = Markup('<svg class="fill" height="10" role="presentation">{}</svg>')
    back = Markup('<rect class="rail" width="100%" height="10" rx="2"/>')
    own = Markup('<rect class="{}" width="{}" height="10" rx="2"/>').format(kind, _part(share))
    return bar.format(back + own)


def _part(share: float) -> str:
    return f"{min(max(share, 0.0), 1.0):.2%}"
