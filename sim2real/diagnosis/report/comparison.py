"""Two diagnoses side by side, as a page for a person.

    write_text("comparison.html", render(earlier, later))

The same robot before and after a repair, two robots of one make, or one log under two models. It
sets values and intervals side by side and tests nothing: intervals that do not overlap are
said to differ.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sim2real.diagnosis.report import axes, html, provenance, text
from sim2real.diagnosis.schema import Cause, Report
from sim2real.runs.errors import Sim2RealError

FILE = "report.json"
Key = tuple[str, str | None, str | None]


def render(earlier: Report, later: Report) -> str:
    """Return the page."""
    return html.page("comparison.html").render(view(earlier, later))


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
    both = [
        {(c.effect, c.extra.get("body") or c.where, c.side): c for c in one.values} for one in pair
    ]
    causes = [_row(key, [one.get(key) for one in both]) for key in both[0] | both[1]]
    joints = [{where.joint: where for where in one.where} for one in pair]
    return {
        "pair": pair,
        "names": [", ".join(provenance.names(one.evidence.inputs)) for one in pair],
        "badges": [text.SUBTITLES[one.verdict] for one in pair],
        "causes": causes,
        "summary": _summary(causes),
        "joints": {name: [one.get(name) for one in joints] for name in joints[0] | joints[1]},
    }


def _row(key: Key, found: Sequence[Cause | None]) -> dict[str, Any]:
    """Return the row of an effect to which one diagnosis or both give a value."""
    known = [cause for cause in found if cause is not None]
    ends = [value for cause in known for value in (cause.value, *cause.value_ci)]
    about = {"name": text.format_effect(*key), "found": found, "verdict": _verdict(*found)}
    return {**about, "like": known[0], "scale": axes.inset(min(ends), max(ends))}


def _verdict(first: Cause | None, second: Cause | None) -> str:
    if second is None:
        return "gone"
    if first is None:
        return "new"
    apart = first.value_ci[0] > second.value_ci[1] or second.value_ci[0] > first.value_ci[1]
    return "differs" if apart else "alike"


def _summary(causes: Sequence[dict[str, Any]]) -> str:
    """Return in a sentence what is not alike."""
    said = {"new": "found only later", "gone": "found only earlier", "differs": "of another value"}
    names = {kind: [one["name"] for one in causes if one["verdict"] == kind] for kind in said}
    parts = [f"{words}: {', '.join(names[kind])}" for kind, words in said.items() if names[kind]]
    whole = "; ".join(parts) or "both find the same, within their intervals"
    return whole[0].upper() + whole[1:] + "."
