"""The curve of a cause's confidence, fitted to answers about robots of another engine.

    python -m benchmarks.confidence                                 # the curve, and how good it is
    python -m benchmarks.confidence --add outputs/exam --draw s403  # with a scored exam's answers

A cause's confidence is a product: that a known law is behind the gap at all, a logistic curve over
the log of what stays open, and that it is this law, as its races say. The curve is the maximum of
the likelihood of which answers were right, with a weak prior of its slope. Each answer is also left
out of the fit in turn and judged by the others: a table of confidence and share right, and the
expected calibration error. The setting of the diagnosis is `causes.calibration`.
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from benchmarks.study import command
from sim2real.diagnosis.attribution.alike import calibrated
from sim2real.diagnosis.settings import DEFAULT
from sim2real.exam.thirdparty.tables import EDGES, expected_error
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

RESULTS = Path(__file__).parent / "results" / "confidence.csv"
HEAD = ("draw", "case", "kind", "races", "closed", "right")
SLOPE, WEIGHT = 2.0, 0.01  # the prior of the slope: its mean, and half its precision
LEAST = 0.01  # no confidence is smaller, nor nearer to 1


class Answer(NamedTuple):
    """An answer with a cause: what its races say, what is closed, and whether it is right."""

    draw: str
    case: str
    kind: str
    races: float
    closed: float
    right: int


def read(path: Path) -> list[Answer]:
    """Return the answers that are kept in a table with the columns HEAD."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return [
        Answer(
            row["draw"],
            row["case"],
            row["kind"],
            float(row["races"]),
            float(row["closed"]),
            int(row["right"]),
        )
        for row in rows
    ]


def answers_of(exam: Path, draw: str) -> list[Answer]:
    """Return the answers with a cause of an exam's folder that was scored.

    What the races say is the confidence over the curve that the diagnosis has.
    """
    found = []
    with (exam / "cases.csv").open(encoding="utf-8", newline="") as file:
        marks = [row for row in csv.DictReader(file) if row["right"] not in ("", "nan")]
    for mark in marks:
        report = json.loads((exam / "answers" / mark["case"] / "report.json").read_text("utf-8"))
        if not report["causes"]:
            continue
        closed = float(report["gap"]["closed"])
        known = calibrated(1.0, closed, DEFAULT.causes)
        races = min(report["causes"][0]["confidence"] / known, 1.0)
        right = int(float(mark["right"]))
        found.append(Answer(draw, mark["case"], mark["kind"], races, closed, right))
    return found


def fit(answers: Sequence[Answer]) -> tuple[float, float]:
    """Return intercept and slope of the curve, in log odds and over -log of what stays open."""
    races, left, right = _columns(answers)

    def loss(curve: np.ndarray) -> float:
        p = confidence(races, left, curve)
        likelihood = right * np.log(p) + (1 - right) * np.log(1 - p)
        return float(WEIGHT * (curve[1] - SLOPE) ** 2 - likelihood.sum())

    start = np.array(DEFAULT.causes.calibration)
    found = minimize(loss, start, method="Nelder-Mead")
    return float(found.x[0]), float(found.x[1])


def confidence(
    races: np.ndarray, left: np.ndarray, curve: Sequence[float] | np.ndarray
) -> np.ndarray:
    """Return the confidence of causes, (N,).

    Args:
        races: how sure the races are, in [0, 1], (N,).
        left: share of the gap that stays open, in (0, 1], (N,).
        curve: intercept and slope.
    """
    known = 1 / (1 + np.exp(-(curve[0] - curve[1] * np.log(left))))
    return np.clip(races * known, LEAST, 1 - LEAST)


def left_out(answers: Sequence[Answer]) -> np.ndarray:
    """Return each answer's confidence under the curve of the others, (N,)."""
    found = []
    for i, one in enumerate(answers):
        curve = fit([*answers[:i], *answers[i + 1 :]])
        races, left, _ = _columns([one])
        found.append(confidence(races, left, curve)[0])
    return np.array(found)


def table(answers: Sequence[Answer]) -> Table:
    """Return confidence and share right by bins, each answer left out of its own curve."""
    said, right = left_out(answers), np.array([one.right for one in answers], float)
    made = Table(("confidence", "answers", "said", "right"))
    for low, high in pairwise(EDGES):
        own = (said >= low) & (said < high)
        if own.any():
            name = f"{low:g} to {min(high, 1.0):g}"
            made.add(name, int(own.sum()), float(said[own].mean()), float(right[own].mean()))
    curve = fit(answers)
    made.notes += [
        f"Curve: {curve[0]:.2f} - {curve[1]:.2f} log(1 - closed), of {len(answers)} answers; the "
        f"diagnosis has {DEFAULT.causes.calibration}.",
        f"Calibration error, left out one by one: {expected_error(said, right):.3f}.",
    ]
    return made


def _columns(answers: Sequence[Answer]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    races, closed, right = np.array([one[3:] for one in answers], float).reshape(-1, 3).T
    return races, 1 - np.clip(closed, 0.0, 1 - LEAST), right


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    parser = command("confidence", __doc__)
    add = parser.add_argument
    add("--add", type=Path, help="folder of a scored exam whose answers are added")
    add("--draw", default="", help="what these are called")
    add("--answers", type=Path, default=RESULTS, help="table of the answers")
    chosen = parser.parse_args(arguments)
    if chosen.add is not None and not (chosen.add / "cases.csv").is_file():
        parser.error(f"{chosen.add} holds no cases.csv; score the exam first (exam.most=0)")
    answers = read(chosen.answers)
    if chosen.add is not None:
        new = answers_of(chosen.add, chosen.draw)
        known = {(one.draw, one.case) for one in new}
        answers = [one for one in answers if (one.draw, one.case) not in known] + new
        rows = [HEAD, *((*a[:3], f"{a.races:.4f}", f"{a.closed:.4f}", a.right) for a in answers)]
        write_text(chosen.answers, "".join(",".join(map(str, row)) + "\n" for row in rows))
    print(table(answers).markdown())
    return 0


if __name__ == "__main__":
    sys.exit(main())
