"""`report.html`: a diagnosis as a page for a person.

    write_html("report.html", report)

One file without links to anything outside: pictures are inline SVG, the script that lets a reader
browse whole recordings is inline too, and the page is complete without it. Names that come from
files are escaped.
"""

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jinja2
import mujoco
import numpy as np
from markupsafe import Markup

from envs.effects import EFFECTS
from envs.models import load_spec
from sim2real.diagnosis.preflight.checks import NOTES
from sim2real.diagnosis.report import (
    axes,
    closed_loop,
    motion,
    provenance,
    robot_drawing,
    svg,
    text,
)
from sim2real.diagnosis.report.recordings import recordings
from sim2real.diagnosis.schema import Cause, Report
from sim2real.diagnosis.settings import TINY
from sim2real.runs.files import write_text
from sim2real.runs.pages import template

PAGE = Path(__file__).parent / "page"
SECONDS = 3.0  # of a window of a recording
JOINTS = 3  # that get windows of their own
SHOWN = 8  # candidates before the rest is folded
DIGITS = 3  # after the point, of tints and seconds
DARKEST, BEND = 0.8, 0.8  # tint of the whole gap, and the exponent of a share's
FRAME = 900  # px: height of a page in a notebook


def write_html(path: str | Path, report: Report) -> Path:
    """Write the page atomically; return its path.

    A report that was read from report.json has no evidence, and fewer plots.
    """
    return write_text(path, render(report))


def render(report: Report) -> str:
    """Return the page."""
    return page("report.html").render(view(report))


def page(name: str) -> jinja2.Template:
    """Return the template of a page; `"style.css" | part` is a file of the folder as it is."""

    def part(name: str) -> Markup:
        return Markup((PAGE / name).read_text(encoding="utf-8"))

    words = (text.quantity, text.percent, text.interval, text.degrees, text.label)
    words += (text.format_effect, text.format_cause, text.verdict_sentence, text.details)
    pictures = (svg.track, svg.numbers, svg.fill, tint)
    return template(PAGE / name, *words, provenance.number, *pictures, part)


def framed(report: Report) -> str:
    """Return the page as a frame that a notebook can show."""
    frame = Markup(
        '<iframe srcdoc="{}" width="100%" height="{}" style="border: 0"'
        ' sandbox="allow-scripts allow-downloads"></iframe>'
    )
    return str(frame.format(render(report), FRAME))


def _embedded(tree: Any, indent: int | None = None) -> Markup:
    """Return JSON as it can stand in a page."""
    return Markup(json.dumps(tree, indent=indent, allow_nan=False).replace("<", "\\u003c"))


def view(report: Report) -> dict[str, Any]:
    """Return what the page shows, by name."""
    evidence, causes = report.evidence, [_cause(n, c) for n, c in enumerate(report.values, 1)]
    found, total = recordings(report)
    browsed = {"recordings": found, "causes": [cause["title"] for cause in causes]}
    model = _model(report)
    if model is not None and found:
        browsed["skeleton"] = motion.skeleton(model)
    return {
        "report": report,
        "evidence": evidence,
        "answer": _embedded(report.to_json(), indent=1),
        "header": provenance.header(evidence.inputs),
        "badge": text.SUBTITLES[report.verdict],
        "findings": [f for f in report.preflight if f.check not in NOTES],
        "notes": [f for f in report.preflight if f.check in NOTES],
        "ladder": _ladder(report),
        "replay": _replay(report),
        "robot": robot_drawing.robot(model, {w.joint: w.share for w in report.where}),
        "strip": _strip(report),
        "causes": causes,
        "played": closed_loop.view(report),
        "windows": _windows(report),
        "restarts": any(len(trace.starts) > 1 for trace in evidence.traces),
        "data": _embedded(browsed),
        "recordings": found,
        "total": total,
        "numbers": {(c.effect, c.where, c.side): n for n, c in enumerate(report.values, 1)},
        "shown": SHOWN,
        "bands": _bands(report),
        "inputs": provenance.flat(evidence.inputs),
        "numerics": text.numerics(report.numerics),
        "command": provenance.command(evidence.inputs),
        "replayed": " ".join(provenance.sources(evidence.inputs)),
        "names": ", ".join(provenance.names(evidence.inputs)) or "recordings",
    }


def _ladder(report: Report) -> dict[str, Any] | None:
    """Return the rungs, and the scale of their pictures; None where there are none."""
    rungs, gap = report.evidence.ladder, report.gap
    if not rungs:
        return None
    kinds = ["before", *["step" for _ in rungs[1:-2]], "after"][: len(rungs) - 1]
    sizes = [size for rung in rungs for size in (rung.gap, *rung.ci)]
    factor, unit = text.scaling(gap.unit, gap.before)
    scale = axes.scale_for(sizes, gap.noise_floor, factor)
    return {"rows": list(zip(rungs, [*kinds, "floor"], strict=True)), "scale": scale, "unit": unit}


def _replay(report: Report) -> str:
    """Return what `run=replay` says of the logs, before and after."""
    if report.replay is None:
        return ""
    said = [(report.replay.before, "the model as given"), (report.replay.after, "effects.yaml")]
    parts = []
    for error, name in said if report.effects else said[:1]:
        figure = "a simulation that diverges"
        if error is not None:
            mixed = report.gap.unit == "spread"
            figure = f"{error:.3g} (rad and m)" if mixed else text.quantity(error, report.gap.unit)
        parts.append(f"{figure} with {name}")
    return ", ".join(parts)


def _model(report: Report) -> mujoco.MjModel | None:
    """Return the first model that the inputs name and that is there to be read."""
    for path in report.evidence.inputs.get("models", []):
        try:
            return load_spec(path).compile()
        except ValueError:
            continue
    return None


def _strip(report: Report) -> dict[str, Any]:
    """Return kinds of moments, the largest share first, and the joints' shares of the whole gap."""
    shares = [{r.name: joint.share * r.share for r in joint.regimes} for joint in report.where]
    whole: Counter[str] = Counter()
    for own in shares:
        whole.update(own)
    names, units = [name for name, _ in whole.most_common()], _units(report)
    rows = [
        {"joint": joint, "unit": units[joint.joint], "shares": [joint.share, *map(own.get, names)]}
        for joint, own in zip(report.where, shares, strict=True)
    ]
    return {"regimes": names, "rows": rows}


def _bands(report: Report) -> list[dict[str, Any]]:
    """Return the tables of frequencies, one for each of the joints' units, each on one scale."""
    tables, every, units = [], report.evidence.bands, _units(report)
    for unit in dict.fromkeys(units[band.joint] for band in every):
        rows = [band for band in every if units[band.joint] == unit]
        sizes = [size for band in rows for size in (band.before, band.after, band.floor)]
        factor, shown = text.scaling(unit, max(sizes))
        floor = min([band.floor for band in rows if band.floor > 0], default=TINY)
        scale = axes.scale_for(sizes, floor, factor)
        about = {"si": unit, "unit": shown, "most": max(sizes)}
        tables.append({"rows": rows, "scale": scale, **about})
    return tables


def _units(report: Report) -> dict[str, str]:
    """Return rad or m for each joint, as far as the evidence shows."""
    known = {trace.joint: trace.unit for trace in report.evidence.traces}
    common = report.gap.unit if report.gap.unit != "spread" else ""
    joints = [w.joint for w in report.where] + [b.joint for b in report.evidence.bands]
    return {joint: known.get(joint, common) for joint in joints}


def tint(share: float | None) -> str:
    """Return a share's tint, never so dark that text on it is hard to read."""
    return str(round(DARKEST * min(max(share or 0.0, 0.0), 1.0) ** BEND, DIGITS))


def _cause(number: int, cause: Cause) -> dict[str, Any]:
    """Return a cause with what its effect looks like and where it comes from."""
    effect = EFFECTS.get(cause.effect)
    title = text.format_cause(cause)
    usual = {e.name: e.default for e in effect.extras} if effect else {}
    return {
        "number": number,
        "title": title[0].upper() + title[1:],
        "cause": cause,
        "effect": effect,
        "picture": _typical(cause, *effect.typical) if effect else "",
        "extra": {k: v for k, v in cause.extra.items() if k != "body" and v != usual.get(k)},
    }


def _typical(cause: Cause, low: float, high: float) -> Markup:
    """Draw the value on a line that spans what real robots show."""
    scale = axes.inset(min(low, cause.value_ci[0]), max(high, cause.value_ci[1]))
    return svg.track(cause.value_ci, [(cause.value, "after")], scale=scale, ticks=(low, high))


def _windows(report: Report) -> list[dict[str, Any]]:
    """Return pieces of recordings for the joints with the largest shares of the gap."""
    found = []
    for joint in [w.joint for w in report.where][:JOINTS]:
        traces = [trace for trace in report.evidence.traces if trace.joint == joint]
        pieces = [piece for trace in traces for piece in svg.pieces(trace, SECONDS)]
        if pieces:
            found.append({"joint": joint, "pictures": [_window(*one) for one in _chosen(pieces)]})
    return found


def _chosen(pieces: list[svg.Piece]) -> Iterator[tuple[str, svg.Piece]]:
    """Yield the piece with the largest gap before, a typical one, and that with the largest after.

    Pieces that overlap one chosen before are left out.
    """
    before, after = (np.array([p.error(line) for p in pieces]) for line in svg.LINES[1:])
    orders = {
        "Largest gap of the model as given": np.argsort(before)[::-1],
        "A typical moment": np.argsort(np.abs(before - np.median(before))),
        "Largest gap that is left": np.argsort(after)[::-1],
    }
    chosen: list[svg.Piece] = []
    for title, order in orders.items():
        free = (pieces[i] for i in order if not any(map(pieces[i].overlaps, chosen)))
        piece = next(free, None)
        if piece is not None:
            chosen.append(piece)
            yield title, piece


def _window(title: str, piece: svg.Piece) -> dict[str, Any]:
    trace, start, end = piece
    error = piece.error("nominal")
    before, after = (text.quantity(piece.error(n), trace.unit, error) for n in svg.LINES[1:])
    place = f"{trace.log}, episode {trace.episode}"
    spoken = (
        f"{trace.joint} in {place}, {start:.1f} to {end:.1f} s: "
        f"error {before} before, {after} after"
    )
    shown = {"log": trace.log, "episode": trace.episode, "joint": trace.joint}
    shown |= {"from": round(start, DIGITS), "to": round(end, DIGITS)}
    return {
        "title": title,
        "place": f"{place}, {max(start, 0.0):.1f} to {end:.1f} s",
        "before": before,
        "after": after,
        "picture": svg.window(piece, spoken),
        "view": json.dumps(shown),
    }
