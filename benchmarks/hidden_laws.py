"""Does `run=identify` find how robots are distributed, from the logs of a few of them?

    python -m benchmarks.hidden_laws --cases 60          # hours; goes on where it stopped
    python -m benchmarks.hidden_laws --cases 3 --npe     # beside it, whether NPE is calibrated

A case hides a law of four parameters of an emulated arm2: normal, normal with two of them
correlated (0.8 either way), or two kinds of robots apart in two of them. Eight robots are drawn
from it, and each is recorded once. `identify=cma` gets their logs, the nominal model and a uniform
prior. Asked is whether the 90 % region of what it found (ellipsoids about its mean) holds a ninth
robot of the law, how many of 200 such robots it holds, whether the mean's own region holds the
law's mean, and whether the energy distance between 500 draws of it and of the law, in widths of the
prior, is below that of the prior. Intervals are exact binomial ones. A row a case in
`hidden_laws.csv`; a case that is there is not run again.
"""

import csv
import logging
import os
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.distance import cdist
from scipy.stats import chi2

from benchmarks.cases import Cases, share, typed
from benchmarks.study import at_least, command
from envs.distribution import Distribution, Entry
from envs.effects import make
from envs.marginals import uniform
from hardware.config import Robot
from hardware.excite import excite
from hardware.log import Log
from hardware.stand import home_pose
from sim2real.exam.logs import drive, exam_robot, motions
from sim2real.identification.data import Recordings
from sim2real.identification.identify import identify
from sim2real.identification.methods.base import FitContext
from sim2real.identification.methods.matching import Matching
from sim2real.identification.methods.npe import FILE, Npe
from sim2real.identification.providers.replay import replay
from sim2real.identification.scores.aligned import KStep
from sim2real.identification.searches import Cma
from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval
from sim2real.runs.tables import Table

ROBOT, SIZE, SECONDS = "arm2", 0.5, 8.0  # of each log
ROBOTS, FRESH, DRAWS = 8, 200, 500
KINDS = ("normal", "correlated", "two kinds")
PLACES = (
    ("coulomb_friction", "shoulder", 0.0, 0.08),  # N·m
    ("coulomb_friction", "elbow", 0.0, 0.08),
    ("motor_strength", None, 0.6, 1.2),
    ("payload", "forearm", 0.0, 0.06),  # kg
)
MIDDLE, SPREAD = (0.3, 0.7), (0.03, 0.1)  # of a law, in widths of the prior
APART, NARROW = 0.3, 0.03  # of two kinds of robots
CORRELATION, REGION = 0.8, 0.9


class HiddenLaw(NamedTuple):
    """A mixture of normal laws of equal weight, in widths of the prior."""

    means: np.ndarray  # (K, P)
    covariance: np.ndarray  # (P, P) of each

    def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return robots (count, P), none outside the prior."""
        kinds = np.arange(count) % len(self.means)
        noise = rng.multivariate_normal(np.zeros(len(self.covariance)), self.covariance, count)
        return np.clip(self.means[kinds] + noise, 0.0, 1.0)


class Row(NamedTuple):
    """What came of a case."""

    case: str  # seed and number
    kind: str
    held: int  # whether the region holds a ninth robot
    inside: float  # share of further robots that it holds
    mean: int  # whether the mean's region holds the law's mean
    energy: float  # distance from the law
    prior: float  # of the prior
    coverage: float  # of held-out readings, by the 90 % band
    npe: str  # least p of NPE's ranks, if asked for
    seconds: str  # of processor time


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, run what is left, and keep the table."""
    parser = command("hidden_laws", __doc__, "results")
    parser.add_argument("--cases", type=at_least(1), default=6, help="a third of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--npe", action="store_true", help="check NPE's calibration, too")
    given = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    cases = Cases(given.results / "hidden_laws.csv", Row._fields)
    with TemporaryDirectory() as folder:
        robot = exam_robot(ROBOT, Path(folder))

        def judged(number: int) -> list[dict[str, Any]]:
            return [judge(number, robot, given.seed, given.npe)._asdict()]

        rows = cases.run(given.seed, given.cases, judged)
    keep(typed(Row, rows), given.results, given.seed)
    return 0


def prior() -> Distribution:
    """Return the prior, uniform over each parameter's range."""
    entries = [
        Entry(make(name, where=where), (uniform(low, high),)) for name, where, low, high in PLACES
    ]
    return Distribution(tuple(entries))


def drawn(kind: str, rng: np.random.Generator) -> HiddenLaw:
    """Draw a law of a kind."""
    count = len(PLACES)
    means = rng.uniform(*MIDDLE, (1, count))
    deviations = rng.uniform(*SPREAD, count)
    two = rng.choice(count, 2, replace=False)
    sign = float(rng.choice([-1.0, 1.0]))
    if kind == "two kinds":
        apart = np.zeros(count)
        apart[two] = APART / 2 * np.array([1.0, sign])
        means, deviations = np.concatenate([means - apart, means + apart]), np.full(count, NARROW)
    correlation = np.eye(count)
    if kind == "correlated":
        correlation[two[0], two[1]] = correlation[two[1], two[0]] = sign * CORRELATION
    return HiddenLaw(means, correlation * np.outer(deviations, deviations))


def judge(number: int, robot: Robot, seed: int, npe: bool) -> Row:
    """Draw a law, record robots of it, identify, and compare."""
    rng = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    law = drawn(kind, rng)
    logs = [recorded(robot, values, rng) for values in law.sample(rng, ROBOTS)]
    start, given = sum(os.times()[:4]), prior()
    data = Recordings(logs, robot.model)
    outcome = identify(data, Matching(KStep(), Cma()), given, run=FitContext(seed=number))
    spent = sum(os.times()[:4]) - start
    found, fresh = outcome.found, law.sample(rng, FRESH)[rng.permutation(FRESH)]
    draws = shares(found.sample(rng, DRAWS))
    there = holds(draws, fresh)
    sure = np.asarray(found.columns("uncertainty")) / widths()
    near = np.sum(((shares(found.mean) - law.means.mean(axis=0)) / sure) ** 2)
    truth = law.sample(rng, DRAWS)
    uniform_draws = shares(given.sample(rng, DRAWS))
    return Row(
        f"{seed}-{number}",
        kind,
        int(there[0]),
        round(float(there.mean()), 3),
        int(near <= chi2.ppf(REGION, len(PLACES))),
        round(energy(draws, truth), 4),
        round(energy(uniform_draws, truth), 4),
        round(outcome.judged.coverage, 3) if outcome.judged else float("nan"),
        f"{least_p(data, given, number):.3g}" if npe else "",
        f"{spent:.0f}",
    )


def recorded(robot: Robot, values: np.ndarray, rng: np.random.Generator) -> Log:
    """Record one robot, of values (P,) in widths of the prior."""
    plan = excite(robot, home_pose(robot), SECONDS, motions(robot), rng, SIZE)
    hidden = [
        {"effect": name, "where": where, "value": low + float(share) * (high - low)}
        for (name, where, low, high), share in zip(PLACES, values, strict=True)
    ]
    return drive(robot, hidden, plan, int(rng.integers(2**31)))


def least_p(data: Recordings, given: Distribution, seed: int) -> float:
    """Return the least p of NPE's ranks over the parameters; far below 0.01: not calibrated."""
    with TemporaryDirectory() as folder:
        Npe().fit(replay, given, data, FitContext(seed=seed, folder=Path(folder)))
        with (Path(folder) / FILE).open(newline="", encoding="utf-8") as file:
            return min(float(row["p"]) for row in csv.DictReader(file))


def widths() -> np.ndarray:
    """Return the widths of the prior (P,)."""
    return np.array([high - low for *_, low, high in PLACES])


def shares(values: np.ndarray) -> np.ndarray:
    """Return values (..., P) in widths of the prior, from its lower ends."""
    return (values - np.array([low for *_, low, _ in PLACES])) / widths()


def holds(draws: np.ndarray, robots: np.ndarray) -> np.ndarray:
    """Return which robots (n, P) are in the 90 % region of draws (D, P), (n,).

    The region is the ellipsoid of the draws' covariance about their mean that holds so many.
    """
    mean = draws.mean(axis=0)
    inverse = np.linalg.inv(np.cov(draws.T))
    far = [np.einsum("np,pq,nq->n", x, inverse, x) for x in (draws - mean, robots - mean)]
    return far[1] <= np.quantile(far[0], REGION)


def energy(one: np.ndarray, other: np.ndarray) -> float:
    """Return the energy distance between two samples (n, P), (m, P).

    The root of 2 E|x - y| - E|x - x'| - E|y - y'| (Székely and Rizzo 2013).
    """
    apart = 2 * cdist(one, other).mean() - cdist(one, one).mean() - cdist(other, other).mean()
    return float(np.sqrt(max(apart, 0.0)))


def keep(own: Sequence[Row], out: Path, seed: int) -> None:
    """Write hidden_laws.md, a row for each kind of a seed's cases."""
    columns = ("law", "cases", "holds a ninth robot", "of 200 robots it holds", "holds the mean")
    table = Table((*columns, "nearer than the prior", "energy distance", "of the prior"))
    for kind in (*KINDS, "all"):
        some = [row for row in own if kind in (row.kind, "all")]
        if some:
            table.add(kind, len(some), *_figures(some))
    table.notes.append(
        f"`python -m benchmarks.hidden_laws --cases {len(own)} --seed {seed}`: {ROBOTS} emulated "
        f"robots ({ROBOT}) of a hidden law of {len(PLACES)} parameters, {SECONDS:g} s of each, "
        "identified by CMA-ES. Shares with exact 95 % intervals, else medians; distances in "
        "widths of the prior."
    )
    ranks = [float(row.npe) for row in own if row.npe]
    if ranks:
        table.notes.append(
            f"NPE's ranks: least p of four parameters {', '.join(f'{p:.2g}' for p in ranks)}."
        )
    write_text(out / "hidden_laws.md", table.markdown())


def _figures(rows: Sequence[Row]) -> list[Interval | float]:
    nearer = [int(row.energy < row.prior) for row in rows]
    return [
        share([row.held for row in rows]),
        float(np.median([row.inside for row in rows])),
        share([row.mean for row in rows]),
        share(nearer),
        float(np.median([row.energy for row in rows])),
        float(np.median([row.prior for row in rows])),
    ]


if __name__ == "__main__":
    raise SystemExit(main())
