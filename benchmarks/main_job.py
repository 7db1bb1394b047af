"""What does `make run` end with, on several training seeds?

    python -m benchmarks.main_job                       # seeds 0 to 4: ten minutes each on 2 cores
    python -m benchmarks.main_job --seeds 0 1
    python -m benchmarks.main_job --report              # the table of what there is

Runs the main job, `sim2real +experiment=esmaml`, with each seed, but for the film. A run that is
there is not run again, one that was interrupted goes on. The interval of a seed is over adaptations
and their episodes, that of the median over seeds.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.study import claimed, command, sim2real, trained
from sim2real.evaluation.scores import GridScores
from sim2real.runs.statistics import Interval, bootstrap, mean
from sim2real.runs.tables import Table

RESULTS = Path(__file__).parent / "results"
DRAWS = 10_000  # resamples of an interval
ASKED = 1100.0  # mean return over the grid after adaptation


def train(folder: Path, seed: int) -> bool:
    """Run the main job with a seed unless it was; return whether it is done."""
    with claimed(folder) as mine:
        if not mine or done(folder):
            return done(folder)
        resume = [f"resume={folder}"] if trained(folder) else []
        return sim2real(
            "+experiment=esmaml", f"seed={seed}", "video=none", f"hydra.run.dir={folder}", *resume
        )


def done(folder: Path) -> bool:
    """Return whether a run was evaluated."""
    return (folder / "evaluation.json").is_file()


def table(runs: dict[int, GridScores]) -> Table:
    """Return each seed's returns over the grid, and their median over seeds."""
    made = Table(("seed", "training steps", "before adaptation", "after 3 episodes", "gain"))
    rng, means = np.random.default_rng(0), []
    for seed, scores in runs.items():
        values = scores.before, scores.after, scores.after - scores.before
        cells = [scores.interval(value, mean, DRAWS, rng) for value in values]
        means.append([float(value.mean()) for value in values])
        made.add(f"{seed}", float(scores.frames[0]), *cells)
    if len(runs) > 1:
        made.add("median", None, *(_median(column, rng) for column in np.array(means).T))
    return made


def _median(values: np.ndarray, rng: np.random.Generator) -> Interval:
    def median(units: np.ndarray) -> np.ndarray:
        return np.median(units, axis=(-2, -1))

    return bootstrap(values[:, None], median, rng, draws=DRAWS, resample="rows")


def report(folder: Path, results: Path) -> bool:
    """Write the table of the runs that are there; return whether there are any."""
    found = {int(f.name[4:]): f for f in folder.glob("seed*") if done(f)}
    if not found:
        print(f"no run in {folder}; start without --report", file=sys.stderr)
        return False
    runs = {seed: GridScores.read(found[seed]) for seed in sorted(found)}
    made = table(runs)
    made.notes.append(
        f"Mean return over 180 Hoppers; asked for: a median of {ASKED:g} after adaptation. "
        "Intervals: 95 %, of a seed over its adaptations and their episodes, of the median over "
        "seeds (bootstrap)."
    )
    made.notes.append("Made by `python -m benchmarks.main_job`.")
    made.write(results / "main_job", title="The main job")
    return True


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    parser = command("main_job", __doc__)
    add = parser.add_argument
    add("--seeds", type=int, nargs="+", default=list(range(5)), help="training seeds")
    add("--report", action="store_true", help="run nothing, write the table of what there is")
    add("--out", type=Path, default=Path("outputs/bench_long/main_job"), help="folder of the runs")
    add("--results", type=Path, default=RESULTS, help="folder of the table")
    chosen = parser.parse_args(arguments)
    out = chosen.out.resolve()
    if chosen.report:
        return int(not report(out, chosen.results))
    failed = [seed for seed in chosen.seeds if not train(out / f"seed{seed}", seed)]
    return int(not report(out, chosen.results) or bool(failed))


if __name__ == "__main__":
    sys.exit(main())
