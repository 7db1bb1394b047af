"""`report.html`: a diagnosis as a page for a person.

    write_html("report.html", report)

One file without links to anything outside: pictures are inline SVG, the script that lets a reader
browse whole recordings is inline too, and the page is complete without it. Names that come from
files are escaped.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import mujoco
import numpy as np
from markupsafe import Markup

from envs.effects import EFFECTS
from sim2real.diagnosis.preflight.channels import NOTES
from sim2real.diagnosis.report import figure, made, svg, words
from sim2real.diagnosis.schema import Cause, Report, SingleFit, Trace, Where
from sim2real.diagnosis.settings import TINY
from sim2real.runs.files import write_text

PAGE = Path(__file__).parent / "page"
SECONDS = 3.0  # of a window of a recording
JOINTS = 3  # that get windows of their own
SHOWN = 8  # candidates before the rest is folded
LONGEST, BUDGET = 20_000, 100_000  # rows that a reader can browse, of a recording and in all
DIGITS, FLOOR_DIGITS, TIME_DIGITS, TINT_DIGITS = 4, 6, 3, 3  # after the point
SPARE = 1.05  # length of a scale, of the largest value on it
DARKEST, BEND = 0.8, 0.8  # tint of the whole gap, and the exponent of a share's
START, SPAN = 0.04, 0.92  # of a line: where the typical values begin, and their length
STEPPED = ("before", "after", "floor")  # rungs beside the steps


def write_html(path: str | Path, report: Report) -> Path:
    """Write the page, whole or not at all; return its path.

    Args:
        path: the file.
        report: with its evidence; a report that was read from report.json has fewer pictures.

    Raises:
        OSError: the file cannot be written.
    """
    return write_text(path, render(report))


def render(report: Report) -> str:
    """Return the page."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(PAGE),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"quantity": words.quantity, "percent": words.percent}
    environment.filters |= {"interval": words.interval, "degrees": words.degrees}
    return environment.get_template("report.html").render(view(report))


def view(report: Report) -> dict[str, Any]:
    """Return what the page shows, by name."""
    evidence = report.evidence
    return {
        "style": Markup((PAGE / "style.css").read_text(encoding="utf-8")),
        "script": Markup((PAGE / "script.js").read_text(encoding="utf-8")),
        "report": report,
        "gap": report.gap,
        "badge": words.SUBTITLES[report.verdict],
        "sentence": words.sentence(report),
        "details": words.details(report),
        "findings": [f for f in report.preflight if f.check not in NOTES],
        "notes": [f for f in report.preflight if f.check in NOTES],
        "ladder": _ladder(report),
        "replay": _replay(report),
        "robot": _robot(report),
        "regimes": _regimes(report.where),
        "strip": _strip(report),
        "causes": [_cause(number, cause) for number, cause in enumerate(report.causes, 1)],
        "windows": _windows(report),
        "fitted": any(not trace.held_out.all() for trace in evidence.traces),
        "recordings": _recordings(evidence.traces),
        "traces": len(evidence.traces),
        "singles": _singles(evidence.singles),
        "shown": SHOWN,
        "bands": _bands(report),
        "inputs": made.flat(evidence.inputs),
        "settings": [made.setting(row) for row in evidence.settings],
        "numerics": words.numerics(report.numerics),
        "command": made.command(evidence.inputs),
        "replayed": " ".join(made.sources(evidence.inputs)),
        "names": ", ".join(made.names(evidence.inputs)) or "recordings",
    }


def _replay(report: Report) -> str:
    """Return what `run=replay` says of the logs, before and after."""
    if report.replay is None:
        return ""

    def figure_of(error: float | None) -> str:
        if error is None:
            return "a simulation that diverges"
        mixed = report.gap.unit == "spread"
        return f"{error:.3g} (rad and m)" if mixed else words.quantity(error, report.gap.unit)

    before = f"{figure_of(report.replay.before)} with the model as given"
    return (
        f"{before}, {figure_of(report.replay.after)} with effects.yaml" if report.causes else before
    )


def _ladder(report: Report) -> list[dict[str, Any]]:
    """Return the rungs, each with its picture on one scale from 0."""
    rungs, gap = report.evidence.ladder, report.gap
    most = SPARE * max([r.ci[1] for r in rungs] + [r.gap for r in rungs] + [TINY])
    kinds = ["before", *["step"] * (len(rungs) - len(STEPPED)), "after", "floor"]
    if len(rungs) < len(STEPPED):
        kinds = ["before", "floor"]
    floor = gap.noise_floor / most
    return [
        {
            "label": words.label(rung.label),
            "value": words.quantity(rung.gap, gap.unit, gap.before),
            "ci": words.interval(rung.ci, gap.unit, gap.before),
            "picture": svg.track(
                rung.ci[0] / most, rung.ci[1] / most, [(rung.gap / most, kind)], floor=floor
            ),
            "kind": kind,
        }
        for rung, kind in zip(rungs, kinds, strict=False)
    ]


def _robot(report: Report) -> Markup:
    """Return a drawing of the robot, if a model that the inputs name is there to be read."""
    for path in report.evidence.inputs.get("models", []):
        try:
            model = mujoco.MjModel.from_xml_path(str(path))
        except ValueError:
            continue
        names = {model.joint(i).name for i in range(model.njnt)}
        return figure.robot(model, {w.joint: w.share for w in report.where if w.joint in names})
    return Markup("")


def _regimes(where: Sequence[Where]) -> list[str]:
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
    """Return rad or m for each joint, as far as the evidence tells."""
    known = {trace.joint: trace.unit for trace in report.evidence.traces}
    common = report.gap.unit if report.gap.unit != "spread" else ""
    joints = [w.joint for w in report.where] + [b.joint for b in report.evidence.bands]
    return {joint: known.get(joint, common) for joint in joints}


def _cell(share: float | None) -> dict[str, Any]:
    return {"text": "", "tint": 0.0} if share is None else _shaded(share)


def _shaded(share: float) -> dict[str, Any]:
    """Return a share as text and as a tint, never so dark that the text is hard to read."""
    return {"text": words.percent(share), "tint": _tint(share)}


def _tint(share: float) -> float:
    return round(DARKEST * min(max(share, 0.0), 1.0) ** BEND, TINT_DIGITS)


def _cause(number: int, cause: Cause) -> dict[str, Any]:
    """Return a cause with what its effect looks like and where it comes from."""
    effect = EFFECTS.get(cause.effect)
    low, high = effect.typical if effect else (0.0, 0.0)
    body = cause.extra.get("body")
    title = words.name(cause.effect, body or cause.where, cause.side)
    usual = {e.name: e.default for e in effect.extras} if effect else {}
    extra = {k: v for k, v in cause.extra.items() if k != "body" and v != usual.get(k)}
    return {
        "number": number,
        "title": title[0].upper() + title[1:],
        "cause": cause,
        "body": body,
        "factor": bool(effect and effect.unit == "" and "scale" in effect.hows),
        "symptom": effect.symptom if effect else "",
        "source": effect.source if effect else "",
        "experiment": effect.experiment if effect else "",
        "typical": words.interval((low, high), cause.unit, cause.value) if effect else "",
        "picture": _typical(cause, low, high) if effect else "",
        "closed": svg.fill(cause.closed, "after"),
        "share": words.percent(min(cause.closed, 1.0)),
        "extra": "; ".join(f"{k.replace('_', ' ')}: {made.number(v)}" for k, v in extra.items()),
        "equivalent": [words.name(e.effect, e.where) for e in cause.equivalent],
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
    numbers = [words.quantity(value, trace.unit, before) for value in (before, after)]
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
    }


def _recordings(traces: Sequence[Trace]) -> list[dict[str, Any]]:
    """Return the recordings that a reader can browse: those with the largest gaps, thinned."""
    found, rows = [], 0
    for trace in sorted(traces, key=lambda t: -_relative(t)):
        made = _recording(trace, max(1, math.ceil(len(trace.time) / LONGEST)))
        rows += len(made["time"])
        if found and rows > BUDGET:
            break
        found.append(made)
    return found


def _relative(trace: Trace) -> float:
    """Return the error of the model as given in units of the joint's own motion."""
    error = float(np.sqrt(np.mean((trace.nominal - trace.measured) ** 2)))
    return error / max(float(trace.measured.std()), TINY)


def _recording(trace: Trace, stride: int) -> dict[str, Any]:
    part = slice(None, None, stride)
    lines = {k: np.round(getattr(trace, k)[part], DIGITS).tolist() for k in svg.lines(trace)}
    return {
        "label": f"{trace.joint} – {trace.log}, episode {trace.episode}",
        "unit": trace.unit,
        "floor": round(float(trace.floor), FLOOR_DIGITS),
        "time": np.round(trace.time[part], TIME_DIGITS).tolist(),
        "held": trace.held_out[part].astype(int).tolist(),
        **lines,
    }


def _singles(singles: Sequence[SingleFit]) -> list[dict[str, Any]]:
    return [
        {
            "name": words.name(c.effect, c.where, c.side),
            "value": words.quantity(c.value, c.unit),
            "closed": words.percent(c.closed),
            "ci": f"{words.percent(c.ci[0])} to {words.percent(c.ci[1])}",
            "picture": svg.track(c.ci[0], c.ci[1], [(c.closed, "after")]),
        }
        for c in singles
    ]


def _bands(report: Report) -> list[dict[str, Any]]:
    """Return rows of the table of frequencies, each with a picture on its joint's scale."""
    bands, units = report.evidence.bands, _units(report)
    most = {b.joint: 0.0 for b in bands}
    for band in bands:
        most[band.joint] = max(most[band.joint], band.before, band.after, TINY)
    rows = []
    for band in bands:
        scale = SPARE * most[band.joint]
        dots = [(band.after / scale, "after"), (band.before / scale, "before")]
        rows.append(
            {
                "joint": band.joint,
                "unit": units[band.joint],
                "range": f"{band.low:.3g} to {band.high:.3g}\N{NO-BREAK SPACE}Hz"
                if math.isfinite(band.high)
                else f"above {band.low:.3g}\N{NO-BREAK SPACE}Hz",
                "before": band.before,
                "after": band.after,
                "floor": band.floor,
                "picture": svg.track(dots[0][0], dots[1][0], dots[::-1], band.floor / scale),
            }
        )
    return rows
