"""Simulation-based calibration: is a posterior as wide as it should be?

    checked = calibrate(ranks, truths, summaries, names)
    checked.p                                    # (P,) of uniform ranks; far below 0.01: it is not

Truths are drawn from the prior and simulated. Among draws of the posterior that each simulation is
given, the truth's rank is uniform if the posterior is right (Talts et al. 2018, arXiv:1804.06788).
A Kolmogorov-Smirnov test says whether it is.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import kstest

from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

DRAWS = 200  # of each posterior; ranks go from 0 to this
ALARM = 0.01  # a p below is a posterior that is not calibrated: one right one in a hundred
# of truths (n, P), summaries (n, K), draws
Ranks = Callable[[np.ndarray, np.ndarray, int], np.ndarray]


class Calibration(NamedTuple):
    """The calibration by the ranks, a number for each parameter."""

    names: tuple[str, ...]
    count: int  # simulated truths
    distance: tuple[float, ...]  # Kolmogorov and Smirnov's, of the ranks to a uniform law
    p: tuple[float, ...]
    coverage: tuple[float, ...]  # share of truths within the middle 90 % of the draws

    def line(self) -> str:
        """Return a sentence on the least p."""
        worst = int(np.argmin(self.p))
        return (
            f"ranks of {self.count} simulated truths are uniform with p = {self.p[worst]:.2g} "
            f"({self.names[worst]}, the least of {len(self.p)})"
        )


def calibrate(
    ranks: Ranks, truths: np.ndarray, summaries: np.ndarray, names: tuple[str, ...]
) -> Calibration:
    """Return how uniform the truths' ranks are among draws of their posteriors.

    Args:
        ranks: returns the rank of the truth among the draws of each posterior, (n, P).
        truths: drawn from the prior, none of which the posterior has learned from, (n, P).
        summaries: of a simulation of each, (n, K).
        names: of the parameters.
    """
    found = ranks(truths, summaries, DRAWS)
    # a rank among L draws stands for (rank, rank + 1) / (L + 1); its middle is even enough
    places = (found + 0.5) / (DRAWS + 1)
    tests = [kstest(column, "uniform") for column in places.T]
    inside = (np.abs(places - 0.5) <= 0.45).mean(axis=0)
    return Calibration(
        names,
        len(truths),
        tuple(float(test.statistic) for test in tests),
        tuple(float(test.pvalue) for test in tests),
        tuple(map(float, inside)),
    )


def write(checked: Calibration, path: Path) -> None:
    """Write a line a parameter."""
    made = Table(["parameter", "truths", "distance", "p", "coverage of 90 %"])
    for name, *rest in zip(
        checked.names, checked.distance, checked.p, checked.coverage, strict=True
    ):
        made.add(name, checked.count, *rest)
    write_text(path, made.csv())
