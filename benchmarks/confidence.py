"""How much a nat a reading is worth: the temperature of the diagnosis's confidence.

    python -m benchmarks.confidence outputs/exam            # of a scored exam's answers
    python -m benchmarks.confidence outputs/exam --shown outputs/other

Odds of two explanations are exponentials of their log densities a reading over the temperature
(`inference.temperature`). Another temperature multiplies the log odds of every answer alike, so
that the best one follows from the confidences that an exam's answers have: it is the maximum of the
likelihood of which first causes were right. How good it is, is shown on another exam.
"""

import csv
import json
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import expit, logit

from benchmarks.study import command
from sim2real.diagnosis.settings import DEFAULT
from sim2real.exam.thirdparty.tables import EDGES, expected_error
from sim2real.runs.tables import Table

SPAN = (0.05, 20.0)  # times the present temperature
LEAST = 1e-3  # no confidence is smaller, nor nearer to 1


def read(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return confidence and whether right of the first causes of a scored exam, (N,) each."""
    said, right = [], []
    with (folder / "cases.csv").open(encoding="utf-8", newline="") as file:
        marks = [row for row in csv.DictReader(file) if row["right"] not in ("", "nan")]
    for mark in marks:
        path = folder / "answers" / mark["case"] / "report.json"
        causes = json.loads(path.read_text("utf-8"))["causes"] if path.is_file() else []
        if causes:
            said.append(causes[0]["confidence"])
            right.append(float(mark["right"]))
    return np.array(said), np.array(right)


def at(said: np.ndarray, times: float) -> np.ndarray:
    """Return confidences at so many times the temperature, (N,)."""
    return expit(logit(np.clip(said, LEAST, 1 - LEAST)) / times)


def fit(said: np.ndarray, right: np.ndarray) -> float:
    """Return how many times the temperature makes the answers most probable."""

    def loss(log_times: float) -> float:
        p = np.clip(at(said, np.exp(log_times)), LEAST, 1 - LEAST)
        return -float(np.sum(right * np.log(p) + (1 - right) * np.log(1 - p)))

    found: Any = minimize_scalar(loss, bounds=tuple(np.log(SPAN)), method="bounded")
    return float(np.exp(found.x))


def table(said: np.ndarray, right: np.ndarray) -> Table:
    """Return confidence and share right by bins."""
    made = Table(("confidence", "answers", "said", "right"))
    for low, high in pairwise(EDGES):
        own = (said >= low) & (said < high)
        if own.any():
            name = f"{low:g} to {min(high, 1.0):g}"
            made.add(name, int(own.sum()), float(said[own].mean()), float(right[own].mean()))
    made.notes.append(f"Calibration error: {expected_error(said, right):.3f}.")
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    parser = command("confidence", __doc__)
    parser.add_argument("exam", type=Path, help="folder of the scored exam to calibrate on")
    parser.add_argument("--shown", type=Path, help="folder of another one, to show it on")
    chosen = parser.parse_args(arguments)
    said, right = read(chosen.exam)
    times = fit(said, right)
    now = DEFAULT.inference.temperature
    print(f"temperature {times * now:.3g} nats a row (now {now:g}), of {len(said)} answers")
    shown = read(chosen.shown) if chosen.shown else (said, right)
    print(table(at(shown[0], times), shown[1]).markdown())
    return 0


if __name__ == "__main__":
    sys.exit(main())
