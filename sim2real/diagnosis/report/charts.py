"""The tables of a report whose rows carry a picture: ladder, effects alone, frequencies.

    ladder(report)["rows"]                       # [{"label", "value", "ci", "picture", "kind"}]
    singles(report)                              # effects that were fitted alone
    bands(report, {"elbow": "rad"})              # a table for each unit

Pictures of one table share one scale; it is logarithmic where its sizes lie far apart.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from sim2real.diagnosis.evidence import Band
from sim2real.diagnosis.report import axes, svg, text
from sim2real.diagnosis.schema import Report
from sim2real.diagnosis.settings import TINY

SIZES = ("before", "after", "floor")  # of a band, of every ladder, and their colours


def ladder(report: Report) -> dict[str, Any] | None:
    """Return the rungs, and the numbers of their scale; None where there are none."""
    rungs, gap = report.evidence.ladder, report.gap
    if not rungs:
        return None
    kinds = ["before", *["step"] * (len(rungs) - len(SIZES)), "after"][: len(rungs) - 1]
    sizes = [size for rung in rungs for size in (rung.gap, *rung.ci)]
    factor, unit = text.scaling(gap.unit, gap.before)
    scale, rows = axes.scale_for(sizes, gap.noise_floor, factor), []
    for rung, kind in zip(rungs, [*kinds, "floor"], strict=True):
        ends, dots = None if kind == "floor" else rung.ci, [(rung.gap, kind)]
        rows.append(
            {
                "label": text.label(rung.label),
                "value": text.quantity(rung.gap, gap.unit, gap.before),
                "ci": text.interval(rung.ci, gap.unit, gap.before),
                "picture": svg.track(ends, dots, gap.noise_floor, scale),
                "kind": kind,
            }
        )
    return _table(rows, scale, unit)


def singles(report: Report) -> list[dict[str, Any]]:
    """Return the effects that were fitted alone."""
    order = {(c.effect, c.where, c.side): n for n, c in enumerate(report.values, 1)}
    return [
        {
            "cause": order.get((row.effect, row.where, row.side)),
            "name": text.format_effect(row.effect, row.where, row.side),
            "value": text.quantity(row.value, row.unit),
            "closed": text.percent(row.closed),
            "ci": " to ".join(map(text.percent, row.ci)),
            "picture": svg.track(row.ci, [(row.closed, "after")], ticks=()),
        }
        for row in report.evidence.singles
    ]


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
    """Return the tables of frequencies, one for each of the joints' units, each on one scale."""
    every = report.evidence.bands
    kinds = dict.fromkeys(units[band.joint] for band in every)
    return [_bands([b for b in every if units[b.joint] == unit], unit) for unit in kinds]


def _bands(every: Sequence[Band], unit: str) -> dict[str, Any]:
    sizes = [getattr(band, size) for band in every for size in SIZES]
    factor, name = text.scaling(unit, max(sizes))
    floor = min([band.floor for band in every if band.floor > 0], default=TINY)
    scale, rows = axes.scale_for(sizes, floor, factor), []
    for band in every:
        ends, dots = (band.before, band.after), [(band.before, "before"), (band.after, "after")]
        rows.append(
            {
                "joint": band.joint,
                "range": f"{band.low:.3g} to {band.high:.3g}\N{NO-BREAK SPACE}Hz",
                **{size: text.quantity(getattr(band, size), unit, max(sizes)) for size in SIZES},
                "picture": svg.track(sorted(ends), dots, band.floor, scale),
            }
        )
    return _table(rows, scale, name)


def _table(rows: list[dict[str, Any]], scale: axes.Axis, unit: str) -> dict[str, Any]:
    """Return a table whose pictures share a scale."""
    log = isinstance(scale, axes.Log)
    return {"rows": rows, "scale": svg.numbers(scale, unit), "log": log}
