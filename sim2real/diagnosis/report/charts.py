"""The tables of a report whose rows carry a picture: the ladder and the frequencies.

    ladder(report)["rows"]                       # [(rung, its class of colours)]
    bands(report, {"elbow": "rad"})              # a table for each unit

Pictures of one table share one scale; it is logarithmic where its sizes lie far apart.
"""

from collections.abc import Mapping
from typing import Any

from sim2real.diagnosis.report import axes, text
from sim2real.diagnosis.schema import Report
from sim2real.diagnosis.settings import TINY


def ladder(report: Report) -> dict[str, Any] | None:
    """Return the rungs, and the scale of their pictures; None where there are none."""
    rungs, gap = report.evidence.ladder, report.gap
    if not rungs:
        return None
    kinds = ["before", *["step"] * (len(rungs) - 3), "after"][: len(rungs) - 1]
    sizes = [size for rung in rungs for size in (rung.gap, *rung.ci)]
    factor, unit = text.scaling(gap.unit, gap.before)
    scale = axes.scale_for(sizes, gap.noise_floor, factor)
    return {"rows": list(zip(rungs, [*kinds, "floor"], strict=True)), "scale": scale, "unit": unit}


def bands(report: Report, units: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return the tables of frequencies, one for each of the joints' units, each on one scale."""
    tables, every = [], report.evidence.bands
    for unit in dict.fromkeys(units[band.joint] for band in every):
        rows = [band for band in every if units[band.joint] == unit]
        sizes = [size for band in rows for size in (band.before, band.after, band.floor)]
        factor, shown = text.scaling(unit, max(sizes))
        floor = min([band.floor for band in rows if band.floor > 0], default=TINY)
        scale = axes.scale_for(sizes, floor, factor)
        about = {"si": unit, "unit": shown, "most": max(sizes)}
        tables.append({"rows": rows, "scale": scale, **about})
    return tables
