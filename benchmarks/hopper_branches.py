"""Does training *for* adaptation help, or only adapting? Paired branches of a trunk on the Hopper.

    python -m benchmarks.hopper_branches                           # 6 seeds, 80 M steps each: days
    python -m benchmarks.hopper_branches --trunk 3000000 --branch 3000000
    python -m benchmarks.hopper_branches --report                     # the tables of what there is

Each seed trains a trunk under randomization (`es_dr`), and from it, for as many steps each, three
branches: randomization goes on, or ES-MAML with three or with ten episodes of adaptation. All are
tested alike: on a grid of Hoppers (torso mass by ground friction), before and after some episodes
of hill climbing. What is complete is skipped, what was interrupted goes on.

**The primary contrast, written before any run**: the mean return over the grid after ten episodes,
of the ES-MAML branch of ten episodes less that of the randomized branch, paired by trunk, over six
seeds (0 to 5). Returns of two trainings differ by 190 (standard deviation over the three seeds of
`benchmarks.hopper_grid`); if branches of one trunk correlate by 0.7, six pairs show a difference of
170 with a power of 0.8, and smaller ones stay undecided. It is called "no difference" only if its
90 % interval lies within a tenth of the randomized branch's return (two one-sided tests at 5 %).
All other contrasts are secondary: their intervals are printed and no claim rests on one alone.
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import stats

from benchmarks.hopper_grid import training
from benchmarks.study import at_least, command, folder_lock, sim2real, trained
from sim2real.evaluation.scores import GridScores
from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval
from sim2real.runs.tables import Table

NAME = "hopper_branches"
TRUNK, BRANCH = 20_000_000, 20_000_000  # environment steps
MARGIN = 0.1  # of the randomized branch's return, within which two branches count as alike
LEVEL, ALIKE = 0.95, 0.90  # of the intervals; of the one that must lie within the margin
SEED_FRICTION = "params.draws.1.friction_mode=seed"  # the foot alone, as the study did

BRANCHES = {
    "es_dr": ("randomization", ("+experiment=es_dr",)),
    "esmaml_3": ("ES-MAML, 3 episodes", ("+experiment=esmaml",)),
    "esmaml_10": ("ES-MAML, 10 episodes", ("+experiment=esmaml", "adapt.queries=9")),
}


class Trial(NamedTuple):
    """A way to test a policy: `episodes` of hill climbing, on which ground."""

    episodes: int
    words: tuple[str, ...]
    text: str


TESTS = {
    "10": Trial(10, ("adapt.queries=9",), "10 episodes"),
    "3": Trial(3, ("adapt.queries=2",), "3 episodes"),
    "20": Trial(20, ("adapt.queries=19",), "20 episodes"),
    "10_seed": Trial(10, ("adapt.queries=9", SEED_FRICTION), "10 episodes, friction of the foot"),
}
PRIMARY = ("10", "esmaml_10", "es_dr")  # test, branch, less branch
CONTRASTS = (PRIMARY, ("10", "esmaml_3", "es_dr"), ("3", "esmaml_3", "es_dr"))
MORE = (("20", "esmaml_10", "es_dr"), ("10_seed", "esmaml_10", "es_dr"))


class Plan(NamedTuple):
    """What to run, how long, and where."""

    branches: Sequence[str]
    tests: Sequence[str]
    seeds: Sequence[int]
    trunk: int
    branch: int
    cells: Sequence[int]
    out: Path
    results: Path
    overrides: Sequence[str]  # further settings of every training

    def folder(self, seed: int, *names: str) -> Path:
        """Return the folder of a run."""
        return self.out / f"seed{seed}" / Path(*names)


def run(plan: Plan) -> int:
    """Do all that is not yet done, seed by seed; return how many jobs failed."""
    failed = 0
    for seed in plan.seeds:
        for branch in plan.branches:
            if not train(plan, branch, seed):
                failed += 1
                continue
            failed += sum(not evaluate(plan, branch, test, seed) for test in plan.tests)
    return failed


def train(plan: Plan, branch: str, seed: int) -> bool:
    """Train a branch, and its trunk before it, from where they stopped; return whether it is there.

    A branch that another program trains just now counts as not there.
    """
    trunk = plan.folder(seed, "trunk")
    if not _train(plan, trunk, ("+experiment=es_dr",), seed, plan.trunk):
        return False
    words = (*BRANCHES[branch][1], f"start={trunk}")
    return _train(plan, plan.folder(seed, branch), words, seed, trained(trunk) + plan.branch)


def _train(plan: Plan, folder: Path, words: tuple[str, ...], seed: int, frames: int) -> bool:
    with folder_lock(folder) as mine:
        if (steps := trained(folder)) >= frames:
            return True
        if not mine:
            return False
        words = (*words, "keep_checkpoints=1", *plan.overrides)
        return sim2real(*training(folder, seed, frames, words, steps > 0))


def evaluate(plan: Plan, branch: str, test: str, seed: int) -> bool:
    """Test a branch unless it was; return whether its scores are there."""
    folder = plan.folder(seed, f"{branch}_after_{test}")
    with folder_lock(folder) as mine:
        if (folder / "evaluation.json").is_file():
            return True
        masses, frictions = plan.cells
        return mine and sim2real(
            *("run=evaluate", f"checkpoint={plan.folder(seed, branch)}", f"seed={seed}"),
            *("adapt=hillclimb", "eval=grid_hopper", "eval.adaptations=3", "eval.episodes=3"),
            *(f"eval.grid.axes.0.count={masses}", f"eval.grid.axes.1.count={frictions}"),
            *TESTS[test].words,
            f"hydra.run.dir={folder}",
        )


def read(plan: Plan) -> dict[tuple[str, str], dict[int, GridScores]]:
    """Return the scores that are there, by test and branch, then by seed."""
    found: dict[tuple[str, str], dict[int, GridScores]] = {}
    for test in TESTS:
        for branch in BRANCHES:
            for folder in sorted(plan.out.glob(f"seed*/{branch}_after_{test}")):
                if (folder / "evaluation.json").is_file():
                    seed = int(folder.parent.name[4:])
                    found.setdefault((test, branch), {})[seed] = GridScores.read(folder)
    return found


def interval(values: np.ndarray, level: float = LEVEL) -> Interval | float:
    """Return the mean of one number a seed, (R,), with Student's interval; alone for one seed."""
    middle = float(values.mean())
    if len(values) < 2:
        return middle
    half = float(stats.t.ppf((1 + level) / 2, len(values) - 1) * stats.sem(values))
    return Interval(middle, middle - half, middle + half)


def returns(table: Table, found: dict[tuple[str, str], dict[int, GridScores]]) -> None:
    """Add a line for each branch and test: returns over the grid, before and after."""
    for (test, branch), runs in found.items():
        before, after = (
            np.array([float(getattr(one, when).mean()) for one in runs.values()])
            for when in ("before", "after")
        )
        steps = float(np.mean([one.frames[0] for one in runs.values()]))
        cells = (interval(before), interval(after), interval(after - before))
        table.add(BRANCHES[branch][0], TESTS[test].text, len(runs), steps, *cells)


def each_run(found: dict[tuple[str, str], dict[int, GridScores]]) -> Table:
    """Return a line for each branch, test and seed."""
    table = Table(("branch", "tested_with", "seed", "training_steps", "before", "after"))
    for (test, branch), runs in found.items():
        for seed, one in runs.items():
            means = (float(values.mean()) for values in (one.before, one.after))
            table.add(branch, test, seed, one.frames[0], *means)
    return table


def contrast(
    found: dict[tuple[str, str], dict[int, GridScores]], test: str, branch: str, other: str
) -> tuple[int, Interval | float, str] | None:
    """Compare two branches after a test, paired by trunk.

    Returns:
        Pairs, the difference of mean returns with its 95 % interval, and what it says: "holds" (the
        branch is above the other), "contradicted", "alike" within the margin, or "undecided"; None
        where no seed has both.
    """
    one, rest = found.get((test, branch), {}), found.get((test, other), {})
    if not (seeds := sorted(set(one) & set(rest))):
        return None
    first, second = (np.array([float(x[s].after.mean()) for s in seeds]) for x in (one, rest))
    gap = interval(first - second)
    if not isinstance(gap, Interval):
        return len(seeds), gap, "undecided, one seed"
    if gap.excludes(0.0):
        return len(seeds), gap, "holds" if gap.value > 0 else "contradicted"
    near, bound = interval(first - second, ALIKE), MARGIN * float(second.mean())
    assert isinstance(near, Interval)
    alike = -bound < near.low and near.high < bound
    return len(seeds), gap, f"alike within {bound:.0f}" if alike else "undecided"


def report(plan: Plan) -> bool:
    """Write the tables of the runs that are there; return whether there are any."""
    found = read(plan)
    if not found:
        print(f"no scores in {plan.out}; start without --report", file=sys.stderr)
        return False
    table = Table(("branch", "tested with", "seeds", "training steps", "before", "after", "gain"))
    returns(table, found)
    for test, branch, other in (*CONTRASTS, *MORE):
        if (made := contrast(found, test, branch, other)) is None:
            continue
        pairs, gap, answer = made
        shown = (
            f"{gap.value:.1f} [{gap.low:.1f}, {gap.high:.1f}]" if isinstance(gap, Interval) else gap
        )
        kind = "Primary contrast" if (test, branch, other) == PRIMARY else "Secondary"
        table.notes.append(
            f"{kind}: {BRANCHES[branch][0]} less {BRANCHES[other][0]}, both after "
            f"{TESTS[test].text}: {shown} over {pairs} pairs: {answer}."
        )
    some = next(iter(next(iter(found.values())).values()))
    table.notes.append(
        f"Mean return over {some.grid.size} Hoppers, three adaptations each, scored on three fresh "
        "episodes. Brackets: 95 %, Student's over training seeds; differences are paired by trunk."
    )
    table.notes.append(f"Made by `{repeat_line(plan)}`.")
    table.write(plan.results / NAME, title="Branches of one trunk: training for adaptation")
    write_text(plan.results / f"{NAME}_runs.csv", each_run(found).csv())
    return True


def repeat_line(plan: Plan) -> str:
    """Return the command line that repeats this."""
    sets = f" --set {' '.join(plan.overrides)}" if plan.overrides else ""
    seeds, cells = " ".join(map(str, plan.seeds)), " ".join(map(str, plan.cells))
    branches, tests = " ".join(plan.branches), " ".join(plan.tests)
    return (
        f"python -m benchmarks.{NAME} --branches {branches} --tests {tests} --seeds {seeds} "
        f"--trunk {plan.trunk} --branch {plan.branch} --cells {cells}{sets}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    parser = command(NAME, __doc__, "out", "results", "report", "set")
    add, branches, tests = parser.add_argument, list(BRANCHES), list(TESTS)
    add("--branches", nargs="+", default=branches, choices=branches, help=", ".join(branches))
    add("--tests", nargs="+", default=tests, choices=tests, help=", ".join(tests))
    add("--seeds", type=at_least(0), nargs="+", default=list(range(6)), help="training seeds")
    add("--trunk", type=at_least(1), default=TRUNK, help="environment steps of a trunk")
    add("--branch", type=at_least(1), default=BRANCH, help="environment steps of a branch")
    cells = "masses and frictions of the grid"
    add("--cells", type=at_least(1), nargs=2, default=[12, 15], help=cells)
    chosen = parser.parse_args(arguments)
    only = chosen.__dict__.pop("report")
    plan = Plan(**vars(chosen))
    if only:
        return int(not report(plan))
    failed = run(plan)
    return int(not report(plan) or failed > 0)


if __name__ == "__main__":
    sys.exit(main())
