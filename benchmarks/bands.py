"""Do a real robot's logs lie within the band of simulators that other logs of it speak for?

    SIM2REAL_DATA=/data python -m benchmarks.bands xl330
    SIM2REAL_DATA=/data python -m benchmarks.bands so101

A diagnosis says which causes there are (that of `benchmarks.xl330` and `benchmarks.so101`, made if
it is missing); its causes' intervals, times three, are the prior of `identify=cma`. The XL330's
twelve logs are held out three at a time, in a drawn order, and the distribution is that of the
other nine; the SO-101's is that of the four logs that were diagnosed, and ten are held out. Each
held-out log is replayed under a hundred draws. Asked is which share of its readings the 90 % band
of these draws holds, and whether the draws' CRPS is below the absolute error of the distribution's
mean. docs/explanation/evidence.md names the logs, which are not part of this project. Distributions
and diagnoses have a folder; what is there is not repeated.
"""

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks import real_logs, so101, xl330
from benchmarks.cases import over_runs, read_csv, write_csv
from benchmarks.study import RUNS, command
from envs import distribution_file
from envs.distribution import Distribution
from hardware.log import read_logs
from sim2real.identification.data import Recordings
from sim2real.identification.held_out import score_held_out
from sim2real.identification.methods.base import FitContext
from sim2real.identification.methods.matching import Matching
from sim2real.identification.prior import prior_from_candidates
from sim2real.identification.providers.base import AlignedProvider
from sim2real.identification.providers.replay import replay
from sim2real.identification.scores.aligned import KStep
from sim2real.identification.searches import Cma
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

FOLDS = 4  # of the XL330's logs
FIELDS = ("robot", "log", "fold", "before", "after", "coverage", "crps", "absolute")
Split = tuple[list[int], list[int]]  # numbers of the logs that are fitted, and held out


class Case(NamedTuple):
    """A robot's logs, its diagnosis, and which logs are held out."""

    data: Recordings
    report: Path
    splits: list[Split]


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, identify, judge, and keep the table; return the exit status."""
    parser = command("bands", __doc__, "results")
    given = os.environ.get("SIM2REAL_DATA")
    parser.add_argument("robot", choices=list(CASES))
    parser.add_argument("--data", type=Path, default=given and Path(given), help="SIM2REAL_DATA")
    parser.add_argument("--out", type=Path, default=RUNS, help="folder of the diagnoses")
    chosen = parser.parse_args(arguments)
    if chosen.data is None or not (chosen.data / FOLDERS[chosen.robot]).is_dir():
        print("skipped: SIM2REAL_DATA names no such folder (docs/explanation/evidence.md)")
        return 0
    case = CASES[chosen.robot](chosen.data, chosen.out / chosen.robot)
    rows = read_csv(chosen.results / "bands.csv")
    rows = [row for row in rows if row["robot"] != chosen.robot]
    for row in judged(case, chosen.out / chosen.robot / "bands"):
        rows.append({"robot": chosen.robot, **row})
        print(rows[-1], flush=True)
    keep(rows, chosen.results)
    return 0


def servo(data: Path, out: Path) -> Case:
    """Return the XL330's logs, held out three at a time."""
    logs = [log for log in read_logs(data / xl330.FOLDER) if xl330.gain_of(log) in xl330.GAINS]
    real_logs.diagnose(logs, out / "all")
    return Case(Recordings(logs), out / "all", folds(len(logs)))


def arm(data: Path, out: Path) -> Case:
    """Return the SO-101's logs: four were diagnosed, ten are held out."""
    so101.diagnose(data, out)
    model = out / "model.xml"
    logs = so101.logs_of(data, (*so101.FIT, *so101.HELD_OUT), model)
    first, every = len(so101.FIT), len(logs)
    split = (list(range(first)), list(range(first, every)))
    return Case(Recordings(logs, model), out / "diagnosis", [split])


CASES: dict[str, Callable[[Path, Path], Case]] = {"xl330": servo, "so101": arm}
FOLDERS = {"xl330": xl330.FOLDER, "so101": "so101"}


def folds(count: int) -> list[Split]:
    """Return a split for each fold: every log is held out once, in a drawn order."""
    order = np.random.default_rng(0).permutation(count).tolist()
    held = [sorted(order[fold::FOLDS]) for fold in range(FOLDS)]
    return [([k for k in range(count) if k not in own], own) for own in held]


def judged(case: Case, out: Path) -> Iterator[dict[str, str]]:
    """Yield a row for each held-out log; errors are in degrees."""
    prior = prior_from_candidates(case.report, case.data)
    made = replay(case.data, prior.effects, rows=None, seed=0)
    for number, (fitted, held) in enumerate(case.splits):
        found = identified(made, prior, fitted, number, out / f"distribution_{number}.yaml")
        for log in held:
            rng = np.random.default_rng([number, log])
            said = score_held_out(_logs(made, [log]), found, rng)
            degrees = np.degrees(np.mean(made.scale))
            sizes = [said.before, said.after, said.crps, said.absolute]
            before, after, crps, absolute = (f"{degrees * size:.4f}" for size in sizes)
            name = xl330.name_of(case.data.logs[log])
            values = (name, str(number), before, after, f"{said.coverage:.4f}", crps, absolute)
            yield dict(zip(FIELDS[1:], values, strict=True))


def identified(
    made: AlignedProvider, prior: Distribution, logs: Sequence[int], seed: int, path: Path
) -> Distribution:
    """Return the distribution that some logs speak for; it is read where it was written."""
    if path.is_file():
        return distribution_file.read(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    found = Matching(KStep(), Cma()).found(_logs(made, logs), prior, FitContext(seed=seed))
    distribution_file.write(path, found)
    return distribution_file.read(path)


def _logs(made: AlignedProvider, logs: Sequence[int]) -> AlignedProvider:
    return made.subset(np.flatnonzero(np.isin(made.episode, list(logs))))


def keep(rows: Sequence[dict[str, str]], results: Path) -> None:
    """Write bands.csv, a row for each log, and bands.md, a row for each robot."""
    head = ("robot", "logs", "as given (deg)", "with the mean (deg)", "within the 90 % band")
    table = Table((*head, "CRPS (deg)", "absolute error of the mean (deg)"))
    for robot in CASES:
        own = [row for row in rows if row["robot"] == robot]
        if own:
            columns = ([float(row[name]) for row in own] for name in FIELDS[3:])
            table.add(robot, len(own), *map(over_runs, columns))
    table.notes.append(
        "`python -m benchmarks.bands xl330` and `so101`: logs that nothing was fitted to. Root "
        "mean squares and means over readings, then means over logs with 95 % bootstrap intervals."
    )
    write_csv(results / "bands.csv", rows)
    write_text(results / "bands.md", table.markdown())


if __name__ == "__main__":
    sys.exit(main())
