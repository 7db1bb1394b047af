"""How probable a law is that is not in the vocabulary: the prior odds behind a confidence.

    python -m benchmarks.confidence outputs/exam/cases.csv --shown outputs/other/cases.csv
    cd benchmarks/results                                   # where the setting comes from
    python -m benchmarks.confidence thirdparty_5[5-8].csv blindcheck_205[134].csv --held 1

A first cause competes with a law that is missing; its odds are divided by the prior odds of such a
law (`inference.unlisted`). Other prior odds multiply those of every answer alike, so that the best
ones follow from the confidences that exams' answers have: they are the maximum of the likelihood of
which first causes were right. How good they are, is shown on another exam.
"""

import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import expit, logit

from benchmarks.cases import read_csv
from benchmarks.study import command
from sim2real.diagnosis.settings import DEFAULT
from sim2real.exam.score import EDGES
from sim2real.exam.thirdparty.tables import expected_error
from sim2real.runs.tables import Table

SPAN = (1e-3, 1e3)  # times the present prior odds
LEAST = 1e-4  # no confidence is smaller, nor nearer to 1


def read(tables: Sequence[Path]) -> tuple[np.ndarray, np.ndarray]:
    """Return confidence and whether right of the first causes of scored exams, (N,) each.

    Answers to cases that hide nothing are left out: there is no cause that could be right.
    """
    said, right = [], []
    for row in (row for path in tables for row in read_csv(path)):
        asked = row.get("right") not in ("", "nan", None) and row["kind"] != "off_nominal"
        if asked and row["confidence"]:
            said.append(float(row["confidence"]))
            right.append(float(row["right"]))
    return np.array(said), np.array(right)


def at(said: np.ndarray, times: float) -> np.ndarray:
    """Return confidences at so many times the prior odds of a missing law, (N,)."""
    return expit(logit(np.clip(said, LEAST, 1 - LEAST)) - np.log(times))


def fit(said: np.ndarray, right: np.ndarray) -> float:
    """Return how many times the prior odds make the answers most probable."""

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
    parser.add_argument("exams", type=Path, nargs="+", help="tables of cases to calibrate on")
    parser.add_argument("--shown", type=Path, nargs="+", help="tables of others, to show it on")
    now = DEFAULT.inference.unlisted
    parser.add_argument("--held", type=float, default=now, help="prior odds of these exams")
    chosen = parser.parse_args(arguments)
    said, right = read(chosen.exams)
    times = fit(said, right)
    print(f"prior odds {times * chosen.held:.3g} (now {now:g}), of {len(said)} answers")
    shown = read(chosen.shown) if chosen.shown else (said, right)
    print(table(at(shown[0], times), shown[1]).markdown())
    return 0


if __name__ == "__main__":
    sys.exit(main())
