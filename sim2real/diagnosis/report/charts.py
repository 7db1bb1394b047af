"""The tables of a report whose rows carry a picture: ladder, effects alone, frequencies.

    ladder(report)["rows"]                       # [{"label", "value", "ci", "picture", "kind"}]
    singles(report)                              # effects that were fitted, and estimates
    bands(report, {"elbow": "rad"})              # a table for each unit

Pictures of one table share one scale; it is logarithmic where its sizes lie far apart.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup

from sim2real.diagnosis.evidence import Band, SingleFit
from sim2real.diagnosis.report import axes, svg, text
from sim2real.diagnosis.schema import Report
from sim2real.diagnosis.settings import TINY

MILLI = 1e3
NUMBERS = 4  # on a scale, about
STEPPED = ("before", "after", "floor")  # rungs other than the steps


def ladder(report: Report) -> dict[str, Any]:
    """Return the rungs, each with its picture on one scale, and the numbers of that scale."""
    rungs, gap = report.evidence.ladder, report.gap
    if not rungs:
        return {"rows": [], "scale": Markup(""), "log": False}
    kinds = ["before", *["step"] * (len(rungs) - len(STEPPED)), "after", "floor"]
    if len(rungs) < len(STEPPED):
        kinds = ["before", "floor"]
    factor, unit = _unit(gap.unit, gap.before)
    sizes = [factor * size for rung in rungs for size in (rung.gap, *rung.ci)]
    scale = axes.scale_for(sizes, factor * gap.noise_floor)
    floor = float(scale(factor * gap.noise_floor))
    ticks = [float(scale(value)) for value, _ in scale.ticks(NUMBERS)]
    rows = []
    for rung, kind in zip(rungs, kinds, strict=False):
        low, high, at = (float(scale(factor * v)) for v in (*rung.ci, rung.gap))
        ends = (None, None) if kind == "floor" else (low, high)
        rows.append(
            {
                "label": text.label(rung.label),
                "value": text.quantity(rung.gap, gap.unit, gap.before),
                "ci": text.interval(rung.ci, gap.unit, gap.before),
                "picture": svg.track(*ends, [(at, kind)], floor=floor, ticks=ticks),
                "kind": kind,
            }
        )
    return {"rows": rows, "scale": _numbers(scale, unit), "log": isinstance(scale, axes.Log)}


def singles(report: Report) -> list[dict[str, Any]]:
    """Return effects alone in two groups: those that were fitted, and those that were screened."""
    order = {(c.effect, c.where, c.side): n for n, c in enumerate(report.values, 1)}
    rows = report.evidence.singles
    groups = {
        "fitted": [row for row in rows if row.ci is not None],
        "estimates": [row for row in rows if row.ci is None],
    }
    return [
        {"kind": kind, "rows": [_single(row, order) for row in chosen]}
        for kind, chosen in groups.items()
        if chosen
    ]


def _single(row: SingleFit, order: Mapping[Any, int]) -> dict[str, Any]:
    low, high = row.ci or (None, None)
    return {
        "cause": order.get((row.effect, row.where, row.side)),
        "name": text.format_effect(row.effect, row.where, row.side),
        "value": text.quantity(row.value, row.unit),
        "closed": text.percent(row.closed),
        "ci": f"{text.percent(low)} to {text.percent(high)}" if row.ci else "",
        "picture": svg.track(low, high, [(row.closed, "after" if row.ci else "floor")]),
    }


def correlations(report: Report) -> list[dict[str, Any]]:
    """Return rows of the table of how the causes' values go together; none for a single cause."""
    matrix = report.evidence.correlations
    if len(report.values) < 2 or len(matrix) != len(report.values):
        return []
    return [
        {
            "name": text.format_effect(*text.place_of(cause), cause.side),
            "cells": [
                {"text": f"{value:.2f}".replace("-", "−"), "tint": round(abs(float(value)) / 2, 3)}
                for value in row
            ],
        }
        for cause, row in zip(report.values, matrix, strict=True)
    ]


def bands(report: Report, units: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return the tables of frequencies, one for each unit, each on one scale.

    Args:
        report: the report with its evidence.
        units: the units of each joint.
    """
    every = report.evidence.bands
    kinds = dict.fromkeys(units[band.joint] for band in every)
    return [_table([b for b in every if units[b.joint] == unit], unit) for unit in kinds]


def _table(every: Sequence[Band], unit: str) -> dict[str, Any]:
    sizes = [size for band in every for size in (band.before, band.after, band.floor)]
    factor, name = _unit(unit, max(sizes))
    floors = [factor * band.floor for band in every if band.floor > 0]
    scale = axes.scale_for([factor * s for s in sizes], min(floors, default=TINY))
    ticks = [float(scale(value)) for value, _ in scale.ticks(NUMBERS)]
    rows = []
    for band in every:
        before, after, floor = (
            float(scale(factor * v)) for v in (band.before, band.after, band.floor)
        )
        dots = [(before, "before"), (after, "after")]
        rows.append(
            {
                "joint": band.joint,
                "range": f"{band.low:.3g} to {band.high:.3g}\N{NO-BREAK SPACE}Hz",
                **{k: text.quantity(getattr(band, k), unit, max(sizes)) for k in STEPPED},
                "picture": svg.track(
                    min(before, after), max(before, after), dots, floor=floor, ticks=ticks
                ),
            }
        )
    return {"rows": rows, "scale": _numbers(scale, name), "log": isinstance(scale, axes.Log)}


def _unit(unit: str, most: float) -> tuple[float, str]:
    """Return what sizes are multiplied by on a scale, and the name of the unit then."""
    if unit == "spread":
        return 100.0, "%"
    return (MILLI, text.SMALL[unit]) if unit in text.SMALL and most < 1.0 else (1.0, unit)


def _numbers(scale: axes.Linear | axes.Log, unit: str) -> Markup:
    """Draw a scale's numbers; the last one has the unit."""
    ticks = [(float(scale(value)), text) for value, text in scale.ticks(NUMBERS)]
    if ticks:
        at, text = ticks[-1]
        ticks[-1] = (at, f"{text}\N{NO-BREAK SPACE}{unit}")
    return svg.numbers(ticks)
