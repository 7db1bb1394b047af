"""Does adaptation help a Hopper of unknown mass on unknown ground? The study's grid, repeated.

    python -m benchmarks.hopper_grid                    # 3 seeds, 20 million steps each: hours
    python -m benchmarks.hopper_grid --seeds 0 --frames 1000000 --results outputs/try

Trains `es_fixed` (one robot), `es_dr` (randomized robots) and `esmaml` (randomized robots and three
episodes of adaptation) with the same budget of environment steps, evaluates each run over 12 masses
by 15 frictions, and writes hopper_grid.csv, .md and .png, after every run anew. The policies of
`es_dr` are also given `esmaml`'s adaptation, which tells training to adapt from adapting.

Each run has a folder of its own: what is complete is skipped, what was interrupted is resumed.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.study import at_least, command, sim2real, trained
from sim2real.evaluation.grid import Box
from sim2real.evaluation.grid_plots import heatmaps
from sim2real.evaluation.scores import GridScores, merge_runs
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text
from sim2real.runs.statistics import (
    Interval,
    difference,
    fraction_above,
    iqm,
    mean,
    probability_of_improvement,
    wins,
)
from sim2real.runs.tables import Cell, Table

NAME = "hopper_grid"
THRESHOLD, DRAWS = 2000.0, 5000
BOX: Box = {"link_mass.torso": (1.0, 9.0), "ground_friction": (1.5, 2.5)}
STUDY = {  # read off the colours of its figure, mean of 5 seeds, within about 50
    "one robot": (830.0, 1310.0, 660.0, 0.11),
    "uniform randomization": (1490.0, 2920.0, 970.0, 0.23),
    "ES-Sim2Real, adapted": (1890.0, 3160.0, 1430.0, 0.49),
}
DIFFERENCES = """
What differs from the study, beside the seeds:

* **Robot.** Hopper-v5 of Gymnasium 1.4 on MuJoCo 4.0, 1000 steps an episode; the study used an
  older Hopper, whose masses MuJoCo computed otherwise (torso 3.53 kg, now 3.67 kg).
* **Friction.** Here `friction_mode: contact` writes the foot and the floor. The study wrote the
  foot alone, and MuJoCo takes the larger of the two: its five frictions below 1.0 are one and
  the same ground, so that its low frictions are easier than ours.
* **Budget.** Here every method has the same number of environment steps, in the table. The study's
  adaptive method took 200 times the steps of its baselines (0.6 to 0.8 billion against 3 million).
* **Method.** Its baselines are PPO, its policies networks of 128 and 64 units, and its adaptation
  is PPO; here all are evolution strategies on the policy of
  `conf/experiment/esmaml.yaml`, adapted by hill climbing over 3 episodes.
* **Numbers.** The study's are read off the colours of its figure, to about 50.
"""


@dataclass(frozen=True)
class Method:
    """A way to train, and a way to adapt what was trained."""

    name: str  # in the results
    experiment: str  # that trains it
    evaluation: str  # the experiment whose adaptation the evaluation uses


METHODS = (
    Method("es_fixed", "es_fixed", "es_fixed"),
    Method("es_dr", "es_dr", "es_dr"),
    Method("es_dr, adapted", "es_dr", "esmaml"),
    Method("esmaml", "esmaml", "esmaml"),
)


@dataclass(frozen=True)
class Plan:
    """What to run and where."""

    frames: int  # environment steps of each training run
    seeds: Sequence[int]  # of training
    out: Path  # folder of the runs
    results: Path  # folder of the tables and the picture
    # further settings of every run, such as `algorithm.shards=1`; those of `eval` go to the
    # evaluations only
    overrides: Sequence[str] = ()

    def folder(self, method: Method, seed: int) -> Path:
        """Return the training run's folder."""
        return self.out / method.experiment / f"seed{seed}"

    def evaluation(self, method: Method, seed: int) -> Path:
        """Return the folder of the evaluation of a training run."""
        adapted = "" if method.evaluation == method.experiment else f"_{method.evaluation}"
        return self.folder(method, seed) / f"evaluation{adapted}"


def run(plan: Plan) -> None:
    """Do all that is not yet done, and write the results whenever there is more to tell."""
    for seed in plan.seeds:
        for method in METHODS:
            train(plan, method, seed)
            if evaluate(plan, method, seed):
                collect(plan)
    collect(plan)


def train(plan: Plan, method: Method, seed: int) -> None:
    """Train until the budget is spent, from the newest checkpoint if there is one."""
    folder = plan.folder(method, seed)
    done = trained(folder)
    if done >= plan.frames:
        return
    own = [line for line in plan.overrides if not line.startswith("eval")]
    words = (f"+experiment={method.experiment}", *own)
    do(*training(folder, seed, plan.frames, words, done > 0))


def training(
    folder: Path, seed: int, frames: int, words: Sequence[str], begun: bool
) -> Sequence[str]:
    """Return the words of a training for so many steps; one that has begun goes on."""
    if begun:  # takes its policy from itself
        words = (*(w for w in words if not w.startswith("start=")), f"resume={folder}")
    steps = ("iterations=null", f"frames={frames}", "algorithm.warm_up=0")  # adapts at once
    return (*words, f"seed={seed}", *steps, "eval=none", "video=none", f"hydra.run.dir={folder}")


def evaluate(plan: Plan, method: Method, seed: int) -> bool:
    """Evaluate a training run over the grid; return whether that was still to be done."""
    folder, run_folder = plan.evaluation(method, seed), plan.folder(method, seed)
    found = read(folder)
    if found is not None and found.frames[0] == trained(run_folder):
        return False
    do(
        f"+experiment={method.evaluation}",
        "run=evaluate",
        f"checkpoint={run_folder}",
        f"hydra.run.dir={folder}",
        *plan.overrides,
    )
    return True


def do(*arguments: str) -> None:
    """Run a job of the command line; a failure ends this program."""
    if not sim2real(*arguments):
        sys.exit(1)


def read(folder: Path) -> GridScores | None:
    """Return the scores in a folder, or None where no evaluation is complete."""
    try:
        return GridScores.read(folder)
    except Sim2RealError:
        return None


def gather(plan: Plan) -> dict[str, GridScores]:
    """Return the scores of all runs that are complete, by method."""
    gathered = {}
    for method in METHODS:
        found = [read(plan.evaluation(method, seed)) for seed in plan.seeds]
        if parts := [s for s in found if s is not None and s.frames[0] >= plan.frames]:
            gathered[method.name] = merge_runs(parts)
    return gathered


def collect(plan: Plan) -> None:
    """Write hopper_grid.csv, .md and .png from what is complete."""
    scores = gather(plan)
    if not scores:
        return
    write_text(plan.results / f"{NAME}.csv", cells(scores).csv())
    write_text(plan.results / f"{NAME}.md", page(plan, scores))
    picture(scores, plan.results / f"{NAME}.png")


def final(scores: GridScores) -> np.ndarray:
    """Return the mean returns after adaptation, if there is any, of each run and cell, (R, C)."""
    return scores.after.mean(axis=2)


def cells(scores: Mapping[str, GridScores]) -> Table:
    """Return one row for each method, run and cell."""
    names = next(iter(scores.values())).grid.names
    table = Table(("method", "run", "training_steps", *names, "before", "after"))
    for method, found in scores.items():
        means = np.stack([found.before.mean(axis=2), final(found)], axis=-1)  # (R, C, 2)
        for run, steps, own in zip(found.runs, found.frames, means, strict=True):
            for cell, two in zip(found.grid.cells().tolist(), own.tolist(), strict=True):
                table.add(method, run, steps, *cell, *(f"{number:.6g}" for number in two))
    return table


TITLES = {  # of the maps, in their order
    "es_fixed, after": "one robot",
    "es_dr, after": "random robots",
    "es_dr, adapted, after": "random robots, adapted",
    "esmaml, before": "meta-learned",
    "esmaml, after": "meta-learned, adapted",
}


def picture(scores: Mapping[str, GridScores], path: Path) -> None:
    """Draw the grids of all methods on one scale."""
    first = next(iter(scores.values()))
    maps = {}
    for method, found in scores.items():
        for when, values in (("before", found.before), ("after", found.after)):
            if title := TITLES.get(f"{method}, {when}"):
                maps[title] = values.mean(axis=(0, 2))
    heatmaps(first.grid, first.parameters, maps, path, box=BOX)


def page(plan: Plan, scores: Mapping[str, GridScores]) -> str:
    """Return the results as Markdown."""
    complete = all(
        len(scores[m.name].runs) == len(plan.seeds) if m.name in scores else False for m in METHODS
    )
    runs = ", ".join(f"{method} {len(found.runs)}" for method, found in scores.items())
    partial = f"**Partial results.** Runs so far, of {len(plan.seeds)} each: {runs}."
    parts = [
        "# Hopper over 12 masses and 15 frictions",
        *([] if complete else [partial]),
        f"![Mean return over the grid]({NAME}.png)",
        "Framed: the range that training draws from (`es_fixed`: mass 6, friction 2). Returns are "
        "after adaptation where there is any.",
        methods_table(scores).markdown().strip(),
        protocol(scores),
        "## Comparisons",
        comparisons(scores).markdown().strip(),
        DIFFERENCES.strip(),
        f"Made by `{repeat_line(plan)}`; each run's files are below its folder.",
    ]
    return "\n\n".join(parts) + "\n"


def protocol(scores: Mapping[str, GridScores]) -> str:
    """Return how the numbers came about."""
    note = list(scores.values())[-1].note().partition(";")[2].strip()
    return f"Rows of the study: mean of 5 seeds, from its figure. Ours: {note}"


def repeat_line(plan: Plan) -> str:
    """Return the command line that repeats this."""
    seeds = " ".join(map(str, plan.seeds))
    sets = f" --set {' '.join(plan.overrides)}" if plan.overrides else ""
    return f"python -m benchmarks.{NAME} --frames {plan.frames} --seeds {seeds}{sets}"


def methods_table(scores: Mapping[str, GridScores]) -> Table:
    """Return what each method reaches in each region, and what the study's methods did."""
    rng = np.random.default_rng(0)
    columns = ("method", "runs", "training steps", "whole grid", "inside", "outside")
    table = Table((*columns, f"share > {THRESHOLD:g}", "IQM of the grid"))
    for method, found in scores.items():
        inside = found.grid.inside(BOX)
        masks = (np.ones_like(inside), inside, ~inside)
        for name, values in _versions(method, found):
            cells: list[Cell] = [
                found.interval(values[:, m], mean, DRAWS, rng) if m.any() else None for m in masks
            ]
            shares = found.interval(values, fraction_above(THRESHOLD), DRAWS, rng)
            middle = found.interval(values, iqm, DRAWS, rng)
            steps = float(np.mean(found.frames))
            table.add(name, found.repeats, steps, *cells, shares, middle)
    for name, numbers in STUDY.items():
        table.add(f"the study: {name}", 5, None, *numbers, None)
    return table


def _versions(method: str, found: GridScores) -> list[tuple[str, np.ndarray]]:
    if not found.adaptation_episodes:
        return [(method, found.before)]
    if method != "esmaml":
        return [(method, found.after)]
    return [("esmaml, before adapting", found.before), ("esmaml, adapted", found.after)]


def comparisons(scores: Mapping[str, GridScores]) -> Table:
    """Return who is better than whom, over training runs, and what adaptation gains."""
    rng = np.random.default_rng(1)
    table = Table(("comparison", "difference of mean return", "P(improvement)"))
    pairs = (("es_dr", "es_fixed"), ("esmaml", "es_dr"), ("esmaml", "es_dr, adapted"))
    for one, other in pairs:
        if one in scores and other in scores:
            table.add(f"{one} against {other}", *_compare(scores[one], scores[other], rng))
    for method in ("es_dr, adapted", "esmaml"):
        if method in scores:
            found = scores[method]
            gain = found.interval(found.after - found.before, mean, DRAWS, rng)
            chance = found.interval(wins(found.after - found.before), mean, DRAWS, rng)
            table.add(f"{method}: after against before adaptation", gain, chance)
    return table


def _compare(one: GridScores, other: GridScores, rng: np.random.Generator) -> Sequence[Cell]:
    first, second = final(one), final(other)
    if min(len(first), len(second)) > 1:
        gap: Interval | float = difference(first, second, mean, rng, draws=DRAWS)
        return gap, probability_of_improvement(first, second, rng, draws=DRAWS)
    chance = (np.sign(first[:, None] - second[None]).mean() + 1) / 2
    return float(first.mean() - second.mean()), float(chance)


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the command line and run."""
    parser = command(NAME, __doc__, "out", "results", "set")
    add, steps = parser.add_argument, "environment steps of each training run"
    add("--frames", type=at_least(1), default=20_000_000, help=steps)
    add("--seeds", type=at_least(0), nargs="+", default=[0, 1, 2], help="training seeds")
    run(Plan(**vars(parser.parse_args(arguments))))


if __name__ == "__main__":
    main()
