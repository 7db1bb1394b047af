"""Pictures of a report as inline SVG: sharp at every width, readable in print, no script needed.

    picture = window(Piece(trace, 3.0, 6.0), "…")   # measured, simulated before and after
    picture = track((0.2, 0.3), [(0.25, "after")])  # an interval and a dot on a line from 0 to 1

Every text that comes from outside is escaped. Colours are those of Okabe and Ito, and lines differ
in their dashes too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from sim2real.diagnosis.evidence import Trace
from sim2real.diagnosis.report.axes import Axis, Signed
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
SHARES = Axis(0.0, 1.0)


class Piece(NamedTuple):
    """A piece of a trace."""

    trace: Trace
    start: float  # s
    end: float  # s

    @property
    def rows(self) -> np.ndarray:
        """Which rows of the trace lie in it, (T,) bool."""
        return (self.trace.time >= self.start) & (self.trace.time <= self.end)

    def error(self, line: str) -> float:
        """Return the root mean square of a simulation's error over the compared rows."""
        chosen = self.rows & compared(self.trace)
        errors = (getattr(self.trace, line) - self.trace.measured)[chosen]
        return float(np.sqrt(np.mean(errors**2)))

    def overlaps(self, other: Piece) -> bool:
        """Return whether two pieces share some of one recording."""
        one, two = self.trace, other.trace
        same = (one.log, one.episode) == (two.log, two.episode)
        return same and self.start < other.end and other.start < self.end


def pieces(trace: Trace, seconds: float) -> list[Piece]:
    """Return half overlapping pieces of a trace that hold many rows which are compared."""
    time, known = trace.time, compared(trace)
    every = [Piece(trace, float(time[0]), float(time[-1]))]
    if time[-1] - time[0] > seconds:
        starts = np.arange(time[0], time[-1] - seconds, seconds / 2)
        every = [Piece(trace, float(start), float(start + seconds)) for start in starts]
    counts = [int(known[piece.rows].sum()) for piece in every]
    return [p for p, n in zip(every, counts, strict=True) if n > 0 and n >= FULL * max(counts)]


def compared(trace: Trace) -> np.ndarray:
    """Return which rows of a trace the simulation is compared with, (T,) bool."""
    return np.isfinite(trace.nominal)


def lines(trace: Trace) -> tuple[str, ...]:
    """Return what is drawn: without causes there is no corrected line."""
    same = np.array_equal(trace.nominal, trace.corrected, equal_nan=True)
    return LINES[:2] if same else LINES


def window(piece: Piece, title: str) -> Markup:
    """Draw a piece of a trace: positions above, errors below with the noise floor as a band.

    A screen reader says the title.
    """
    trace, inside = piece.trace, np.flatnonzero(piece.rows)
    index = inside[:: max(1, math.ceil(len(inside) / POINTS))]
    time, floor = trace.time[index], trace.floor
    scale = 1 / MILLI if trace.unit in ("rad", "m") else 1.0
    names = lines(trace)
    values = {line: getattr(trace, line)[index] for line in names}
    errors = {line: scale * (values[line] - values["measured"]) for line in names[1:]}
    x = Axis(piece.start, piece.end, LEFT, WIDTH - EDGE)
    shown = np.concatenate([*values.values()])
    low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
    room = max(ROOM * (high - low), LEAST)
    upper = Axis(low - room, high + room, TOP + MAIN, TOP)
    base = TOP + MAIN + GAP
    band = 2 * floor * scale
    lower = _errors([*errors.values()], band, base)
    runs = _runs(trace, index)
    sides = x(np.array([piece.start, piece.end, piece.end, piece.start]))
    parts = [_restarts(piece, x, base + ERROR)]
    parts += [_frame(x, upper, labels=False), _frame(x, lower, labels=True)]
    parts.append(_line(sides, lower(band * np.array([-1, -1, 1, 1])), "band", "Z"))
    parts.append(_line(x(time), upper(values["measured"]), "measured"))
    for line in names[1:]:
        parts += [_line(x(time[run]), upper(values[line][run]), line) for run in runs]
        parts += [_line(x(time[run]), lower(errors[line][run]), line) for run in runs]
    small = f"error, {'m' if scale != 1 else ''}{trace.unit}"
    parts += [_upright(TOP + MAIN / 2, trace.unit), _upright(base + ERROR / 2, small)]
    head = Markup('<svg class="plot" viewBox="0 0 {} {}" role="img" aria-label="{}">')
    size = WIDTH, base + ERROR + BOTTOM
    return head.format(*size, title) + Markup("").join(parts) + Markup("</svg>")


def _errors(errors: Sequence[np.ndarray], floor: float, base: float) -> Axis:
    """Return an axis for errors, logarithmic where the largest is far above the noise."""
    largest = float(np.nanmax(np.abs(np.concatenate(errors))))
    most = SPARE * max(largest, BANDS / 2 * floor, TINY)
    if floor > 0 and most > BENT * floor:
        return Signed(max(floor, most / SPREAD), most, base + ERROR, base)
    return Axis(-most, most, base + ERROR, base)


def _runs(trace: Trace, index: np.ndarray) -> list[np.ndarray]:
    """Return the stretches of rows, as places in `index`, through which a simulation runs on."""
    known = compared(trace)[index]
    number = np.searchsorted(trace.starts, index, side="right")
    breaks = np.flatnonzero((np.diff(number) != 0) | (np.diff(known.astype(int)) != 0)) + 1
    runs = np.split(np.arange(len(index)), breaks)
    return [run for run in runs if len(run) and known[run[0]]]


def _restarts(piece: Piece, x: Axis, bottom: float) -> Markup:
    """Mark where the simulation starts again from the measured state."""
    times = piece.trace.time[piece.trace.starts]
    inside = times[(piece.start < times) & (times < piece.end)]
    line = Markup('<path class="restart" d="M{:.1f} {}V{}"/>')
    return Markup("").join(line.format(at, TOP, bottom) for at in x(inside))


def _frame(x: Axis, y: Axis, labels: bool) -> Markup:
    """Draw grid lines and numbers; those of time below the lower plot only."""
    out = []
    across = Markup('<path class="grid" d="M{} {:.1f}H{}"/>')
    beside = Markup('<text class="n" x="{}" y="{:.1f}">{}</text>')
    for at, text in y.ticks(TICKS if y.start - y.end > TALL else FEW_TICKS):
        out += [across.format(x.start, at, x.end), beside.format(LEFT - NUMBER, at, text)]
    upright = Markup('<path class="grid" d="M{:.1f} {}V{}"/>')
    below = Markup('<text class="t" x="{:.1f}" y="{}">{} s</text>')
    for at, text in x.ticks(TICKS):
        out.append(upright.format(at, y.start, y.end))
        if labels:
            out.append(below.format(min(at, x.end - LAST), y.start + TIME, text))
    return Markup("").join(out)


def _line(x: np.ndarray, y: np.ndarray, kind: str, end: str = "") -> Markup:
    points = "L".join(f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True))
    return Markup('<path class="{}" d="M{}{}"/>').format(kind, points, end)


def _upright(y: float, text: str) -> Markup:
    upright = Markup('<text class="u" transform="translate({} {:.1f}) rotate(-90)">{}</text>')
    return upright.format(UNIT, y, text)


def track(
    ends: Sequence[float] | None,
    dots: Sequence[tuple[float, str]],
    floor: float | None = None,
    scale: Axis = SHARES,
    ticks: Sequence[float] | None = None,
) -> Markup:
    """Draw an interval and dots on a line.

    Args:
        ends: of the interval; None where there is none.
        dots: values, each with its class of colours: before, after, step or floor. The first one's
            is the interval's too.
        floor: up to where it is shaded from the left on; None: it is not.
        scale: of the line, from 0 to 1.
        ticks: values at which thin lines stand; None: those of the scale's numbers.
    """
    out = [Markup('<svg class="track" height="22" role="presentation">')]
    if floor is not None and scale(floor) > 0:
        shade = Markup('<rect class="shade" x="0" y="0" width="{}" height="22"/>')
        out.append(shade.format(_part(scale(floor))))
    line = Markup('<line class="tick" x1="{0}" x2="{0}" y1="0" y2="22"/>')
    lines = map(scale, ticks) if ticks is not None else [at for at, _ in scale.ticks(TICKS)]
    out += [line.format(_part(at)) for at in lines]
    if ends is not None:
        bar = Markup('<line class="bar {}" x1="{}" x2="{}" y1="11" y2="11"/>')
        out.append(bar.format(dots[0][1], *(_part(scale(end)) for end in ends)))
    circle = Markup('<circle class="dot {}" cx="{}" cy="11" r="5"/>')
    out += [circle.format(kind, _part(scale(value))) for value, kind in dots]
    return Markup("").join([*out, Markup("</svg>")])


def numbers(scale: Axis, unit: str = "") -> Markup:
    """Draw the numbers of a scale from 0 to 1; the last one has the unit."""
    text = Markup('<text x="{}" y="12" text-anchor="{}">{}</text>')
    ticks, out = list(scale.ticks(TICKS)), []
    for n, (at, said) in enumerate(ticks, 1):
        side = "start" if at < NEAR else "end" if at > 1 - NEAR else "middle"
        last = f"\N{NO-BREAK SPACE}{unit}" if unit and n == len(ticks) else ""
        out.append(text.format(_part(at), side, said + last))
    head = Markup('<svg class="numbers" height="16" role="presentation">')
    return Markup("").join([head, *out, Markup("</svg>")])


def fill(share: float) -> Markup:
    """Draw a bar from 0 to a share of the width."""
    return Markup(
        '<svg class="fill" height="10" role="presentation">'
        '<rect class="rail" width="100%" height="10" rx="2"/>'
        '<rect class="after" width="{}" height="10" rx="2"/></svg>'
    ).format(_part(share))


def _part(share: float | np.ndarray) -> str:
    return f"{min(max(float(share), 0.0), 1.0):.2%}"
