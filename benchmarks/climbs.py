"""Which hill climbing for which noise: rules of adaptation on a smooth hill, in seconds.

    python -m benchmarks.climbs                 # writes results/climbs.csv and climbs.md

Each rule spends 48 to 51 episodes from the same start, whose height is -1; the top is 0. The hill
has six parameters, so a step of sigma 0.1 is a quarter of the way. A return carries Gaussian noise,
or an error that only ever hurts, in 30 % of the episodes. Gains are shares of the way to the top,
true heights, means over 2000 climbs.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sim2real.learning.adapt import HillClimb
from sim2real.learning.adapt.hillclimb import Mode
from sim2real.runs.statistics import Interval, bootstrap, mean
from sim2real.runs.tables import Table

Law = Literal["Gaussian", "corrupted"]
RESULTS = Path(__file__).parent / "results"
CLIMBS, SIZE, SHARE, DRAWS = 2000, 6, 0.3, 2000
TOP = 1 / np.sqrt(SIZE)  # of each parameter: the start is 1 away
NOISES: tuple[tuple[Law, float], ...] = (
    ("Gaussian", 0.0),
    ("Gaussian", 0.05),
    ("Gaussian", 0.2),
    ("Gaussian", 0.5),
    ("Gaussian", 2.0),
    ("corrupted", 0.2),
    ("corrupted", 2.0),
)


def rule(mode: Mode, queries: int, parallel: int = 1, **more: Any) -> HillClimb:
    """Return a rule that starts with one episode of the policy as it is."""
    own: dict[str, Any] = {"sigma": 0.1, "incumbent_episodes": 1}
    return HillClimb(mode=mode, queries=queries, parallel=parallel, **(own | more))


RULES = {
    "sequential": rule("sequential", 50),
    "sequential, again": rule("sequential", 25, reevaluate_incumbent=True),
    "batch": rule("batch", 10, 5),
    "batch, again": rule("batch", 8, 5, reevaluate_incumbent=True),
    "average": rule("average", 10, 5),
    "average, again": rule("average", 8, 5, reevaluate_incumbent=True),
    "annealed": rule("sequential", 50, sigma=0.2, grow=0.96, shrink=0.96),
    "one fifth": rule("sequential", 50, grow=1.5, shrink=1.5**-0.25),
}


def gains(operator: HillClimb, law: Law, scale: float, seed: int, climbs: int) -> np.ndarray:
    """Return how much of the way to the top climbs gain, (climbs,)."""
    rng, members = np.random.default_rng(seed), np.arange(climbs)
    start = np.zeros((climbs, SIZE), np.float32)
    cohort = operator.start_many(start, [np.random.default_rng([seed, m]) for m in range(climbs)])
    for episode in range(operator.episodes):
        which = np.full(climbs, episode)
        told = height(cohort.candidates(members, which)) + noise(rng, law, scale, climbs)
        cohort.tell(members, which, told)
    return height(cohort.results) + 1.0


def height(theta: np.ndarray) -> np.ndarray:
    """Return heights of parameters (n, SIZE), (n,): 0 at the top, -1 at the start."""
    return -np.square(theta.astype(np.float64) - TOP).sum(axis=1)


def noise(rng: np.random.Generator, law: Law, scale: float, n: int) -> np.ndarray:
    """Draw errors of n returns."""
    drawn = scale * rng.standard_normal(n)
    return drawn if law == "Gaussian" else -np.abs(drawn) * (rng.random(n) < SHARE)


def table(seed: int, climbs: int) -> Table:
    """Return the gain of each rule under each noise."""
    columns = ("rule", "episodes", *(f"{law} {scale:g}" for law, scale in NOISES))
    made = Table(columns)
    for name, operator in RULES.items():
        cells: list[Interval] = []
        for law, scale in NOISES:
            found = gains(operator, law, scale, seed, climbs)[:, None]
            rng = np.random.default_rng(seed)
            cells.append(bootstrap(found, mean, rng, draws=DRAWS, resample="rows"))
        made.add(name, operator.episodes, *cells)
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, climb, and write the table; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.climbs",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seed", type=int, default=0, help="of noise and proposals")
    parser.add_argument("--climbs", type=int, default=CLIMBS, help="of each rule and noise")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of the table")
    chosen = parser.parse_args(arguments)
    if chosen.climbs < 2 or chosen.seed < 0:
        parser.error(f"--climbs {chosen.climbs} must be at least 2, --seed not negative")
    made = table(chosen.seed, chosen.climbs)
    made.notes.append(
        f"`python -m benchmarks.climbs --seed {chosen.seed}`: share of the way to the top that a "
        "climb gains, with 95 % bootstrap intervals over climbs. Noise is in units of that way; "
        "*again* runs the incumbent once more in each round."
    )
    made.write(chosen.results / "climbs")
    print(made.markdown())
    return 0


if __name__ == "__main__":
    sys.exit(main())
