"""Two diagnoses side by side, as a page for a person.

    write_comparison("comparison.html", earlier, later)

The same robot before and after a repair, two robots of one make, or one log under two models. It
sets values and intervals side by side and tests nothing: intervals that do not overlap are
said to differ.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from sim2real.diagnosis.report import axes, html, provenance, svg, text
from sim2real.diagnosis.schema import Cause, Report
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text
from sim2real.runs.pages import template

FILE = "report.json"
START, SPAN = 0.04, 0.92  # of a line: where the smallest value is, and the length to the largest
Key = tuple[str, str | None, str | None]


def write_comparison(path: str | Path, earlier: Report, later: Report) -> Path:
    """Write the page, whole or not at all; return its path."""
    return write_text(path, render(earlier, later))


def render(earlier: Report, later: Report) -> str:
    """Return the page."""
    return template(html.PAGE / "comparison.html", *html.FILTERS).render(view(earlier, later))


def read_report(path: str | Path) -> Report:
    """Return the report of a diagnosis, from its folder or its report.json.

    Raises:
        Sim2RealError: there is none, or it is no report.
    """
    path = Path(path).expanduser()
    file = path / FILE if path.is_dir() else path
    try:
        return Report.from_json(json.loads(file.read_text(encoding="utf-8")))
    except OSError as error:
        raise Sim2RealError(f"{file}: {error.strerror}; name a diagnosis's folder") from None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise Sim2RealError(f"{file}: not a report of a diagnosis ({error})") from None


def view(earlier: Report, later: Report) -> dict[str, Any]:
    """Return the variables of the page template, by name."""
    pair = (earlier, later)
    causes = _causes(pair)
    return {
        "style": Markup("\n".join(map(html.part, html.STYLES))),
        "script": Markup(html.part("theme.js") + "followTheme(() => {});"),
        "names": [", ".join(provenance.names(one.evidence.inputs)) for one in pair],
        "badges": [text.SUBTITLES[one.verdict] for one in pair],
        "sentences": [text.verdict_sentence(one) for one in pair],
        "gaps": [_gap(one, earlier.gap.before) for one in pair],
        "causes": causes,
        "summary": _summary(causes),
        "joints": _joints(pair),
    }


def _gap(report: Report, like: float) -> dict[str, str]:
    gap = report.gap
    return {
        "gap of the model as given": text.quantity(gap.before, gap.unit, like),
        "with the causes": text.quantity(gap.after, gap.unit, like),
        "closed": text.percent(gap.closed),
        "noise floor": text.quantity(gap.noise_floor, gap.unit, like),
    }


def _key(cause: Cause) -> Key:
    return cause.effect, cause.extra.get("body") or cause.where, cause.side


def _causes(pair: Sequence[Report]) -> list[dict[str, Any]]:
    """Return a row for each effect that either diagnosis gives a value."""
    both = [{_key(cause): cause for cause in one.values} for one in pair]
    return [
        _row(key, [one.get(key) for one in both]) for key in dict.fromkeys([*both[0], *both[1]])
    ]


def _row(key: Key, found: Sequence[Cause | None]) -> dict[str, Any]:
    known = [cause for cause in found if cause is not None]
    unit, like = known[0].unit, known[0].value
    ends = [value for cause in known for value in (cause.value, *cause.value_ci)]
    scale = axes.Linear(min(ends), max(ends) or 1.0, START, START + SPAN)
    cells = []
    for cause, kind in zip(found, ("step", "after"), strict=True):
        if cause is None:
            cells.append({"value": "not found", "ci": "", "picture": ""})
            continue
        low, high, at = map(float, scale(np.array([*cause.value_ci, cause.value])))
        cells.append(
            {
                "value": text.quantity(cause.value, unit, like),
                "ci": text.interval(cause.value_ci, unit, like),
                "picture": svg.track(low, high, [(at, kind)]),
            }
        )
    return {"name": text.format_effect(*key), "cells": cells, "verdict": _verdict(found)}


def _verdict(found: Sequence[Cause | None]) -> str:
    first, second = found
    if second is None:
        return "gone"
    if first is None:
        return "new"
    apart = first.value_ci[0] > second.value_ci[1] or second.value_ci[0] > first.value_ci[1]
    return "differs" if apart else "alike"


def _summary(causes: Sequence[dict[str, Any]]) -> str:
    """Return in a sentence what is not alike."""
    said = {"new": "found only later", "gone": "found only earlier", "differs": "of another value"}
    parts = [
        f"{text}: {', '.join(one['name'] for one in causes if one['verdict'] == kind)}"
        for kind, text in said.items()
        if any(one["verdict"] == kind for one in causes)
    ]
    text = "; ".join(parts) or "both find the same, within their intervals"
    return text[0].upper() + text[1:] + "."


def _joints(pair: Sequence[Report]) -> list[dict[str, Any]]:
    """Return each joint's gap and share in both."""
    both = [{where.joint: where for where in one.where} for one in pair]
    rows = []
    for joint in dict.fromkeys([*both[0], *both[1]]):
        known = [one.get(joint) for one in both]
        unit = pair[0].gap.unit
        rows.append(
            {
                "joint": joint,
                "cells": [
                    {"gap": "–", "share": "–"}
                    if where is None
                    else {
                        "gap": text.quantity(where.before, unit if unit != "spread" else ""),
                        "share": text.percent(where.share),
                    }
                    for where in known
                ],
            }
        )
    return rows
