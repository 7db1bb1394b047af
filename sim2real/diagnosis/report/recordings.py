"""Recordings as the page's script reads them: compact, thinned, those with the largest gaps first.

    data, total = recordings(report)             # what fits into a page, and how many there are

Numbers are 16-bit steps between a line's smallest and largest value, times 32-bit floats; both are
little-endian and in base64, so that an hour of a robot stays a page that can be mailed.
"""

import base64
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sim2real.diagnosis.evidence import Signal, Trace
from sim2real.diagnosis.report import svg
from sim2real.diagnosis.schema import Report
from sim2real.diagnosis.settings import TINY

LONGEST = 20_000  # rows of a recording
BUDGET = 4_000_000  # characters of all recordings
STEPS, NOTHING = 65_000, 65_535  # between the smallest and the largest value; what stands for NaN
FLOOR_DIGITS = 6


def recordings(report: Report) -> tuple[list[dict[str, Any]], int]:
    """Return the recordings that a reader can browse, and how many there are.

    Joints are in the order of their shares of the gap.
    """
    evidence = report.evidence
    places = {where.joint: place for place, where in enumerate(report.where)}
    groups: dict[tuple[str, int], list[Trace]] = {}
    for trace in sorted(evidence.traces, key=lambda t: places.get(t.joint, len(places))):
        groups.setdefault((trace.log, trace.episode), []).append(trace)
    order = sorted(groups, key=lambda key: -max(map(relative, groups[key])))
    found, count = [], 0
    for key in order:
        signals = [s for s in evidence.signals if (s.log, s.episode) == key]
        one = _recording(groups[key], signals)
        count += len(json.dumps(one))
        if found and count > BUDGET:
            break
        found.append(one)
    return found, len(groups)


def relative(trace: Trace) -> float:
    """Return the error of the model as given in units of the joint's own motion."""
    if not svg.compared(trace).any():
        return 0.0
    whole = svg.Piece(trace, -math.inf, math.inf)
    return whole.error("nominal") / max(float(trace.measured.std()), TINY)


def _recording(traces: Sequence[Trace], signals: Sequence[Signal]) -> dict[str, Any]:
    first = traces[0]
    stride = max(1, math.ceil(len(first.time) / LONGEST))
    part = slice(None, None, stride)
    return {
        "label": f"{first.log}, episode {first.episode}",
        "log": first.log,
        "episode": first.episode,
        "starts": np.unique(-(-first.starts // stride)).tolist(),  # the next row that is kept
        "joints": [_joint(trace, part) for trace in traces],
        "signals": [
            {key: getattr(signal, key) for key in ("kind", "actuator", "unit", "joint")}
            | {"time": floats(signal.time[part]), "values": packed(signal.values[part])}
            for signal in signals
        ],
    }


def _joint(trace: Trace, part: slice) -> dict[str, Any]:
    return {
        "name": trace.joint,
        "unit": trace.unit,
        "floor": round(float(trace.floor), FLOOR_DIGITS),
        "time": floats(trace.time[part]),
        "measured": packed(trace.measured[part]),
        "lines": {key: packed(line[part]) for key, line in _lines(trace).items()},
    }


def _lines(trace: Trace) -> Mapping[str, np.ndarray]:
    """Return the simulated lines by the causes in the model: "" for none, "0,1", "all"."""
    most, parts = max(map(len, trace.subsets), default=0), trace.subsets.items()
    named = {",".join(map(str, sorted(some))): line for some, line in parts if len(some) < most}
    named[""] = trace.nominal
    if len(svg.lines(trace)) > 2:
        named["all"] = trace.corrected
    return named


def floats(values: np.ndarray) -> str:
    """Return numbers as base64 of 32-bit floats."""
    return base64.b64encode(np.asarray(values, "<f4").tobytes()).decode("ascii")


def packed(values: np.ndarray) -> dict[str, Any]:
    """Return numbers as base64 of 16-bit steps of a size from a lowest value on."""
    known = np.isfinite(values)
    low, high = (float(values[known].min()), float(values[known].max())) if known.any() else (0, 0)
    step = (high - low) / STEPS or 1.0
    counts = np.full(len(values), NOTHING, "<u2")
    counts[known] = np.round((values[known] - low) / step)
    return {"low": low, "step": step, "counts": base64.b64encode(counts.tobytes()).decode("ascii")}
