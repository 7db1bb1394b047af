"""Studies of many trainings: each row with each seed, resumable, shared by several programs.

    run(Plan(rounds, rows, seeds, out, results))

Each run has a folder of its own: what is complete is skipped, what was interrupted is continued.
After each round of seeds `run=report` writes its tables and pictures. Several programs may run the
same plan at once and share the work.
"""

import argparse
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from sim2real.evaluation.study_plots import list_figures
from sim2real.runs.checkpoint import find, read_metadata
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import folder_lock

RESULTS = Path(__file__).parent / "results"
RUNS = Path("outputs/bench_long")  # folders of runs are below it
SIGNALLED = 128  # exit statuses above are those of a job that was told to stop


@dataclass(frozen=True)
class Row:
    """A row of the tables."""

    name: str  # of the row and its folder
    experiment: str  # that trains it
    seeds: int  # how many, from 0 up
    budgets: tuple[int, ...]  # environment steps after which it is evaluated; the last ends it
    overrides: tuple[str, ...] = ()  # of the experiment
    folder: str | None = None  # of another row, whose runs go on; None for its own


Rounds = tuple[tuple[Row, ...], ...]


@dataclass(frozen=True)
class Plan:
    """What to run and where."""

    rounds: Rounds  # the study's rows, those of a round side by side, one round after another
    rows: Sequence[str]  # names of those that are wanted
    seeds: Sequence[int] | None  # of training; None for as many as each row has
    out: Path  # folder of the runs
    results: Path  # folder of the report
    frames: int | None = None  # environment steps of every run instead of its own; None for its own
    overrides: Sequence[str] = ()  # further settings of every run

    def folder(self, row: Row, seed: int) -> Path:
        """Return a run's folder."""
        return self.out / (row.folder or row.name) / f"seed{seed}"

    def budgets(self, row: Row) -> tuple[int, ...]:
        """Return the steps after which a row's runs are evaluated."""
        return row.budgets if self.frames is None else (self.frames,)

    def jobs(self) -> Iterator[list[tuple[Row, int]]]:
        """Yield rounds of runs, those of one seed after those of another."""
        for rows in self.rounds:
            wanted = [row for row in rows if row.name in self.rows]
            most = max((row.seeds for row in wanted), default=0)
            for seed in range(most) if self.seeds is None else self.seeds:
                here = [(r, seed) for r in wanted if self.seeds is not None or seed < r.seeds]
                if here:
                    yield here


def run(plan: Plan) -> int:
    """Do all that is not yet done; write the report after each round that did something.

    Returns:
        How many jobs failed; the others went on.
    """
    failed = 0
    for jobs in plan.jobs():
        found = [train(plan, row, seed) for row, seed in jobs]
        failed += found.count(False)
        if any(done is not None for done in found):
            failed += not report(plan)
    return failed


def train(plan: Plan, row: Row, seed: int) -> bool | None:
    """Train and evaluate one run, from where it stopped.

    Returns:
        Whether it came to its end; None where nothing was left to do, or another program does it.
    """
    folder, done = plan.folder(row, seed), None
    with folder_lock(folder) as mine:
        for budget in plan.budgets(row) if mine else ():
            if evaluated(folder, budget):
                continue
            steps = trained(folder)
            done = sim2real(
                f"+experiment={row.experiment}",
                f"seed={seed}",
                f"frames={max(budget, steps)}",
                f"hydra.run.dir={folder}",
                *([f"resume={folder}"] if steps else []),
                *row.overrides,
                *plan.overrides,
            )
            if not done:
                break
    return done


def trained(folder: Path) -> int:
    """Return the environment steps of the newest checkpoint in a run's folder; 0 without one."""
    try:
        return int(read_metadata(find(folder))["frames"])
    except Sim2RealError:
        return 0


def evaluated(folder: Path, budget: int) -> bool:
    """Return whether a run has scores after at least that many steps."""
    steps = [int(file.stem.rpartition("-")[2]) for file in folder.glob("transfer-*.json")]
    return max(steps, default=0) >= budget


def report(plan: Plan) -> bool:
    """Write the tables and pictures of all runs in the plan's folder; return whether it could."""
    made = Path(f"{plan.out}_report")
    done = sim2real("run=report", f"runs={plan.out}", f"hydra.run.dir={made}")
    if done:
        keep(made, plan.results)
    return done


def keep(made: Path, results: Path) -> None:
    """Copy a report, without what belongs to the job that wrote it, over the one before."""
    for file in [*made.glob("*.md"), *made.glob("*.csv"), *made.glob("plots/*.png")]:
        target = results / file.relative_to(made)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(file.read_bytes())
    for old in list_figures(results):
        if not (made / "plots" / old.name).is_file():
            old.unlink()


def sim2real(*arguments: str) -> bool:
    """Run a job of the command line; return whether it came to its end.

    Raises:
        SystemExit: the job was told to stop.
    """
    status = subprocess.run([sys.executable, "-m", "sim2real", *arguments]).returncode
    if status:
        line = f"sim2real {' '.join(arguments)} ended with status {status}"
        print(f"{line}; start this benchmark again to go on", file=sys.stderr)
    if status < 0 or status > SIGNALLED:
        sys.exit(status)
    return status == 0


def at_least(least: int) -> Callable[[str], int]:
    """Return the type of an option that is a whole number, and not less than another."""

    def number(text: str) -> int:
        if int(text) < least:
            raise argparse.ArgumentTypeError(f"{text} must be at least {least}")
        return int(text)

    return number


def command(name: str, text: str | None, *options: str) -> argparse.ArgumentParser:
    """Return the parser of a benchmark's command line, of a module and what `--help` says.

    It has some usual options: "out", the folder of its runs; "results", that of what is kept;
    "report", to write tables alone; "set", settings of every run.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m benchmarks.{name}",
        description=text,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    if "out" in options:
        add("--out", type=_absolute, default=str(RUNS / name), help="folder of the runs")
    if "results" in options:
        add("--results", type=_absolute, default=str(RESULTS), help="folder of what is kept")
    if "report" in options:
        add("--report", action="store_true", help="run nothing, write the tables of what there is")
    if "set" in options:
        text = "settings of every training"
        add("--set", nargs="*", default=[], metavar="KEY=VALUE", dest="overrides", help=text)
    return parser


def _absolute(path: str) -> Path:
    return Path(path).resolve()


@dataclass(frozen=True)
class Study:
    """A study with a command line."""

    name: str  # of its module, folder and results
    text: str  # what it is, for `--help`
    rounds: Rounds  # its rows
    slow: tuple[str, ...] = ()  # names of rows that run only when asked for

    @property
    def rows(self) -> dict[str, Row]:
        """All rows by their names."""
        return {row.name: row for rows in self.rounds for row in rows}

    def main(self, arguments: Sequence[str] | None = None) -> int:
        """Read the command line and run; return the exit status."""
        parser = command(self.name, self.text, "out", "results", "report", "set")
        parser.set_defaults(results=RESULTS / self.name)
        add, rows = parser.add_argument, ", ".join(self.rows)
        usual = [name for name in self.rows if name not in self.slow]
        less = f" but {' and '.join(self.slow)}, which take hours each" if self.slow else ""
        text = f"of: {rows}; default: all{less}"
        add("--rows", nargs="+", default=usual, metavar="ROW", help=text)
        text = "training seeds; default: each row's own"
        add("--seeds", type=at_least(0), nargs="+", help=text)
        text = "environment steps of every run; default: each row's own"
        add("--frames", type=at_least(1), help=text)
        chosen = parser.parse_args(arguments)
        unknown = [name for name in chosen.rows if name not in self.rows]
        if unknown:
            parser.error(f"no row {unknown[0]!r}; there are: {rows}")
        only = chosen.__dict__.pop("report")
        plan = Plan(self.rounds, **vars(chosen))
        return int(not report(plan) if only else run(plan) > 0)
