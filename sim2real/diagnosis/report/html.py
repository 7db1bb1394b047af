"""`report.html`: a diagnosis as a page for a person.

    write_html("report.html", report)

One file without links to anything outside: pictures are inline SVG, the script that lets a reader
browse whole recordings is inline too, and the page is complete without it. Names that come from
files are escaped.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from markupsafe import Markup

from envs.effects import EFFECTS
from envs.models import load_spec
from sim2real.diagnosis.evidence import Trace
from sim2real.diagnosis.preflight.checks import NOTES
from sim2real.diagnosis.report import (
    charts,
    closed_loop,
    link,
    motion,
    provenance,
    robot_drawing,
    svg,
    text,
)
from sim2real.diagnosis.report.recordings import recordings
from sim2real.diagnosis.schema import Cause, JointGap, Report
from sim2real.runs.files import write_text
from sim2real.runs.pages import template

PAGE = Path(__file__).parent / "page"
SECONDS = 3.0  # of a window of a recording
JOINTS = 3  # that get windows of their own
SHOWN = 8  # candidates before the rest is folded
TINT_DIGITS = 3  # after the point
DARKEST, BEND = 0.8, 0.8  # tint of the whole gap, and the exponent of a share's
START, SPAN = 0.04, 0.92  # of a line: where the typical values begin, and their length
FRAME = 900  # px: height of a page in a notebook
FILTERS = (text.quantity, text.percent, text.interval, text.degrees)
STYLES = ("vendor/uplot.css", "colours.css", "style.css", "plots.css")
SCRIPTS = (
    *("decode", "theme", "panel", "motion", "browser"),
    *("gestures", "switches", "downloads", "links", "start"),
)


def write_html(path: str | Path, report: Report) -> Path:
    """Write the page, whole or not at all; return its path.

    Args:
        path: the file.
        report: the report with its evidence; one that was read from report.json has fewer plots.

    Raises:
        OSError: the file cannot be written.
    """
    return write_text(path, render(report))


def render(report: Report) -> str:
    """Return the page."""
    return template(PAGE / "report.html", *FILTERS).render(view(report))


def framed(report: Report) -> str:
    """Return the page as a frame that a notebook can show."""
    frame = Markup(
        '<iframe srcdoc="{}" width="100%" height="{}" style="border: 0"'
        ' sandbox="allow-scripts allow-downloads"></iframe>'
    )
    return str(frame.format(render(report), FRAME))


def part(name: str) -> str:
    """Return a part of the page."""
    return (PAGE / name).read_text(encoding="utf-8")


def _embedded(report: Report) -> Markup:
    """Return report.json as it can stand in a page."""
    text = json.dumps(report.to_json(), indent=1, ensure_ascii=True, allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))


def view(report: Report) -> dict[str, Any]:
    """Return what the page shows, by name."""
    evidence, causes = report.evidence, [_cause(n, c) for n, c in enumerate(report.values, 1)]
    found, total = recordings(report)
    browsed = {"recordings": found, "causes": [cause["title"] for cause in causes]}
    model = _model(report)
    if model is not None and found:
        browsed["skeleton"] = motion.skeleton(model)
    return {
        "style": Markup("\n".join(map(part, STYLES))),
        "library": Markup(part("vendor/uplot.js")),
        "licence": Markup(part("vendor/uplot.LICENSE")),
        "script": Markup("\n".join(part(f"{name}.js") for name in SCRIPTS)),
        "report": report,
        "answer": _embedded(report),
        "header": provenance.header(evidence.inputs),
        "gap": report.gap,
        "badge": text.SUBTITLES[report.verdict],
        "sentence": text.verdict_sentence(report),
        "details": text.details(report),
        "findings": [f for f in report.preflight if f.check not in NOTES],
        "notes": [f for f in report.preflight if f.check in NOTES],
        "ladder": charts.ladder(report),
        "replay": _replay(report),
        "robot": _robot(report, model),
        "regimes": _regimes(report.where),
        "strip": _strip(report),
        "causes": causes,
        "channels": evidence.channels,
        "played": closed_loop.view(report),
        "windows": _windows(report),
        "restarts": any(len(trace.starts) > 1 for trace in evidence.traces),
        "data": Markup(json.dumps(browsed, ensure_ascii=True).replace("<", "\\u003c")),
        "recordings": browsed["recordings"],
        "total": total,
        "singles": charts.singles(report),
        "shown": SHOWN,
        "correlations": charts.correlations(report),
        "bands": charts.bands(report, _units(report)),
        "links": link.table(evidence.inputs),
        "inputs": provenance.flat(evidence.inputs),
        "settings": [provenance.setting(row) for row in evidence.settings],
        "numerics": text.numerics(report.numerics),
        "command": provenance.command(evidence.inputs),
        "replayed": " ".join(provenance.sources(evidence.inputs)),
        "names": ", ".join(provenance.names(evidence.inputs)) or "recordings",
    }


def _replay(report: Report) -> str:
    """Return what `run=replay` says of the logs, before and after."""
    if report.replay is None:
        return ""

    def figure_of(error: float | None) -> str:
        if error is None:
            return "a simulation that diverges"
        mixed = report.gap.unit == "spread"
        return f"{error:.3g} (rad and m)" if mixed else text.quantity(error, report.gap.unit)

    before = f"{figure_of(report.replay.before)} with the model as given"
    return (
        f"{before}, {figure_of(report.replay.after)} with effects.yaml"
        if report.effects
        else before
    )


def _model(report: Report) -> mujoco.MjModel | None:
    """Return the first model that the inputs name and that is there to be read."""
    for path in report.evidence.inputs.get("models", []):
        try:
            return load_spec(path).compile()
        except ValueError:
            continue
    return None


def _robot(report: Report, model: mujoco.MjModel | None) -> Markup:
    """Return a drawing of the robot, if its model is there."""
    if model is None:
        return Markup("")
    names = {model.joint(i).name for i in range(model.njnt)}
    return robot_drawing.robot(model, {w.joint: w.share for w in report.where if w.joint in names})


def _regimes(where: Sequence[JointGap]) -> list[str]:
    """Return the names of all kinds of moments, the largest share of the whole gap first."""
    shares: dict[str, float] = {}
    for joint in where:
        for regime in joint.regimes:
            shares[regime.name] = shares.get(regime.name, 0.0) + joint.share * regime.share
    return sorted(shares, key=lambda name: -shares[name])


def _strip(report: Report) -> list[dict[str, Any]]:
    """Return a row for each joint; its cells are shares of the whole gap."""
    names, units = _regimes(report.where), _units(report)
    rows = []
    for joint in report.where:
        own = {regime.name: joint.share * regime.share for regime in joint.regimes}
        cells = [own.get(name) for name in names]
        shades = {"share": _shaded(joint.share), "cells": list(map(_cell, cells))}
        rows.append({"joint": joint, "unit": units[joint.joint], **shades})
    return rows


def _units(report: Report) -> dict[str, str]:
    """Return rad or m for each joint, as far as the evidence shows."""
    known = {trace.joint: trace.unit for trace in report.evidence.traces}
    common = report.gap.unit if report.gap.unit != "spread" else ""
    joints = [w.joint for w in report.where] + [b.joint for b in report.evidence.bands]
    return {joint: known.get(joint, common) for joint in joints}


def _cell(share: float | None) -> dict[str, Any]:
    return {"text": "", "tint": 0.0} if share is None else _shaded(share)


def _shaded(share: float) -> dict[str, Any]:
    """Return a share as text and as a tint, never so dark that the text is hard to read."""
    return {"text": text.percent(share), "tint": _tint(share)}


def _tint(share: float) -> float:
    return round(DARKEST * min(max(share, 0.0), 1.0) ** BEND, TINT_DIGITS)


def _cause(number: int, cause: Cause) -> dict[str, Any]:
    """Return a cause with what its effect looks like and where it comes from."""
    effect = EFFECTS.get(cause.effect)
    low, high = effect.typical if effect else (0.0, 0.0)
    body = cause.extra.get("body")
    title = text.format_effect(*text.place_of(cause), cause.side)
    usual = {e.name: e.default for e in effect.extras} if effect else {}
    extra = {k: v for k, v in cause.extra.items() if k != "body" and v != usual.get(k)}
    alike = [
        [text.format_effect(e.effect, e.where) for e in cause.equivalent if e.inseparable == never]
        for never in (False, True)
    ]
    return {
        "number": number,
        "title": title[0].upper() + title[1:],
        "cause": cause,
        "body": body,
        "factor": bool(effect and effect.unit == "" and "scale" in effect.hows),
        "symptom": effect.symptom if effect else "",
        "source": effect.source if effect else "",
        "experiment": effect.experiment if effect else "",
        "typical": text.interval((low, high), cause.unit, cause.value) if effect else "",
        "picture": _typical(cause, low, high) if effect else "",
        "closed": svg.fill(cause.closed, "after"),
        "share": text.percent(min(cause.closed, 1.0)),
        "extra": "; ".join(
            f"{k.replace('_', ' ')}: {provenance.number(v)}" for k, v in extra.items()
        ),
        "equivalent": alike[0],
        "inseparable": alike[1],
    }


def _typical(cause: Cause, low: float, high: float) -> Markup:
    """Draw the value on a line that spans what real robots show."""
    start = min(low, cause.value_ci[0])
    length = max(high, cause.value_ci[1]) - start or 1.0
    values = np.array([*cause.value_ci, cause.value, low, high])
    first, last, dot, *ticks = map(float, START + SPAN * (values - start) / length)
    return svg.track(first, last, [(dot, "after")], ticks=ticks)


def _windows(report: Report) -> list[dict[str, Any]]:
    """Return pieces of recordings for the joints with the largest shares of the gap."""
    found = []
    for joint in [w.joint for w in report.where][:JOINTS]:
        pieces = [
            (trace, span)
            for trace in report.evidence.traces
            if trace.joint == joint
            for span in svg.spans(trace, SECONDS)
        ]
        if pieces:
            found.append({"joint": joint, "pictures": [_window(*w) for w in _chosen(pieces)]})
    return found


def _chosen(pieces: list[tuple[Trace, svg.Span]]) -> list[tuple[str, Trace, svg.Span]]:
    """Return the piece with the largest gap before, a typical one, and that with the largest after.

    Pieces that overlap one chosen before are left out.
    """
    before = [svg.error(trace, "nominal", span) for trace, span in pieces]
    after = [svg.error(trace, "corrected", span) for trace, span in pieces]
    orders = {
        "Largest gap of the model as given": np.argsort(before)[::-1],
        "A typical moment": np.argsort(np.abs(np.array(before) - np.median(before))),
        "Largest gap that is left": np.argsort(after)[::-1],
    }
    chosen: list[tuple[str, Trace, svg.Span]] = []
    for title, order in orders.items():
        free = (pieces[i] for i in order if not any(_overlap(pieces[i], c[1:]) for c in chosen))
        piece = next(free, None)
        if piece is not None:
            chosen.append((title, *piece))
    return chosen


def _overlap(one: tuple[Trace, svg.Span], other: tuple[Trace, svg.Span]) -> bool:
    """Return whether two pieces of one recording share some of it."""
    (first, a), (second, b) = one, other
    same = (first.log, first.episode) == (second.log, second.episode)
    return same and a.start < b.end and b.start < a.end


def _window(title: str, trace: Trace, span: svg.Span) -> dict[str, Any]:
    before, after = (svg.error(trace, line, span) for line in ("nominal", "corrected"))
    numbers = [text.quantity(value, trace.unit, before) for value in (before, after)]
    place = f"{trace.log}, episode {trace.episode}"
    spoken = (
        f"{trace.joint} in {place}, {span.start:.1f} to {span.end:.1f} s: "
        f"error {numbers[0]} before, {numbers[1]} after"
    )
    return {
        "title": title,
        "place": f"{place}, {max(span.start, 0.0):.1f} to {span.end:.1f} s",
        "before": numbers[0],
        "after": numbers[1],
        "picture": svg.window(trace, span, spoken),
        "view": json.dumps(
            {
                "log": trace.log,
                "episode": trace.episode,
                "joint": trace.joint,
                "from": round(span.start, TINT_DIGITS),
                "to": round(span.end, TINT_DIGITS),
            }
        ),
    }
