"""Does a policy that knows its robot do better than one that adapts by its returns?

    python -m benchmarks.conditioned                        # seeds 0 to 4: hours on 2 cores
    python -m benchmarks.conditioned --seeds 0 1 --frames 3000000 --rows conditioned esmaml
    python -m benchmarks.conditioned --report               # the table of what there is

On Hoppers of many masses and frictions: a policy that is told them (the oracle), told what three
episodes' logs say (`adapt=identify`), told what RMA's student guesses, and not told, adapted by
three episodes of hill climbing; beside them ES-MAML with the same hill climbing and a policy with a
memory, for as many steps of training. A run that is there is not run again, one that was
interrupted goes on.

The claims, written before any run: `identify` reaches at least 0.9 of the oracle's mean return over
the grid, and is above ES-MAML after its hill climbing.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.study import claimed, sim2real, trained
from sim2real.evaluation.scores import GridScores
from sim2real.runs.figures import COLOURS, INK, figure
from sim2real.runs.statistics import Interval, bootstrap, mean
from sim2real.runs.tables import Table

RESULTS = Path(__file__).parent / "results"
DRAWS = 10_000  # resamples of an interval
FRAMES = 7_000_000  # environment steps of a training, as in the main job
WARM_UP = 5.5 / 7  # share of ES-MAML's steps without adapting, as in the main job
NEAR = 0.1  # share by which steps of training may differ and count as equal
SHARE = 0.9  # of the oracle's return, that is claimed


class Training(NamedTuple):
    """Something that is trained."""

    words: tuple[str, ...]
    teacher: str | None = None  # the training whose run it learns from; it has its own steps


class Row(NamedTuple):
    """A row of the table: an evaluation of a training."""

    training: str
    text: str
    settings: tuple[str, ...] = ()
    before: bool = False  # whether its returns are those before adapting


UNTOLD = "transforms.with_params.truth=false"
STUDENT = (
    *("env=hopper", "params=mass_friction", "transforms=with_params", "algorithm=distill"),
    *("iterations=null", "frames=300000"),  # beside the teacher's
)
TRAININGS = {
    "conditioned": Training(("+experiment=conditioned",)),
    "esmaml": Training(("+experiment=esmaml",)),
    "student": Training(STUDENT, teacher="conditioned"),
    "gru": Training(("+experiment=hopper_gru",)),
}
EVALUATIONS = {
    "oracle": Row("conditioned", "told the truth", ("adapt=none", "eval.adaptations=1")),
    "identify": Row(
        "conditioned",
        "told what 3 episodes' logs say",
        ("adapt=identify", "eval.adaptations=1"),
    ),
    "climb": Row(
        "conditioned", "told the middle, 3 episodes of hill climbing", (UNTOLD, "adapt=hillclimb")
    ),
    "esmaml": Row("esmaml", "ES-MAML, 3 episodes of hill climbing"),
    "student": Row("student", "told what RMA's student guesses"),
    "gru": Row("gru", "a memory (GRU, PPO)"),
}
UNTOUCHED = {
    "middle": Row("identify", "told the middle", before=True),
    "esmaml_before": Row("esmaml", "ES-MAML, before adapting", before=True),
}


class Plan(NamedTuple):
    """What to run, how long, and where."""

    rows: tuple[str, ...]
    seeds: tuple[int, ...]
    frames: int
    cells: tuple[int, int]
    out: Path
    results: Path

    def run_of(self, training: str, seed: int) -> Path:
        """Return a training's folder."""
        return self.out / training / f"seed{seed}"

    def scores_of(self, row: str, seed: int) -> Path:
        """Return an evaluation's folder."""
        return self.out / "scores" / row / f"seed{seed}"


def train(plan: Plan, name: str, seed: int) -> bool:
    """Train what a row needs unless it is; return whether it is there."""
    training, folder = TRAININGS[name], plan.run_of(name, seed)
    own, goal = list(training.words), plan.frames
    if training.teacher is not None:
        if not train(plan, training.teacher, seed):
            return False
        goal = 0  # as many steps as its words say
        own.append(f"algorithm.teacher.checkpoint={plan.run_of(training.teacher, seed)}")
    if name == "esmaml":
        own.append(f"algorithm.warm_up={round(WARM_UP * plan.frames)}")
    with claimed(folder) as mine:
        steps = trained(folder)
        if steps >= goal and (goal or (folder / "plots").is_dir()):
            return True
        if not mine:
            return False
        return sim2real(
            *own,
            f"seed={seed}",
            *([f"frames={goal}"] if goal else []),
            *("eval=none", "video=none", f"hydra.run.dir={folder}"),
            *([f"resume={folder}"] if steps else []),
        )


def evaluate(plan: Plan, name: str, seed: int) -> bool:
    """Evaluate a row unless it was; return whether its scores are there."""
    row, folder = EVALUATIONS[name], plan.scores_of(name, seed)
    if (folder / "evaluation.json").is_file():
        return True
    if not train(plan, row.training, seed):
        return False
    masses, frictions = plan.cells
    with claimed(folder) as mine:
        return mine and sim2real(
            *("run=evaluate", f"checkpoint={plan.run_of(row.training, seed)}"),
            *("eval=grid_hopper", "eval.adaptations=3", "eval.episodes=3"),
            *(f"eval.grid.axes.0.count={masses}", f"eval.grid.axes.1.count={frictions}"),
            *(f"hydra.run.dir={folder}", *row.settings),
        )


def read(plan: Plan) -> dict[str, dict[int, GridScores]]:
    """Return the scores that are there, by row and seed."""
    found: dict[str, dict[int, GridScores]] = {}
    for name in EVALUATIONS:
        for folder in sorted((plan.out / "scores" / name).glob("seed*")):
            if (folder / "evaluation.json").is_file():
                found.setdefault(name, {})[int(folder.name[4:])] = GridScores.read(folder)
    return found


def means(scores: GridScores, before: bool = False) -> np.ndarray:
    """Return the mean return over the grid, inside and outside the training range, (3,)."""
    values = (scores.before if before else scores.after).mean(axis=(0, 2))  # (C,)
    inside = scores.grid.inside(scores.box)
    parts = (values, values[inside], values[~inside])
    return np.array([part.mean() if len(part) else np.nan for part in parts])


def over_seeds(values: np.ndarray) -> Interval | float:
    """Return the mean of a number of each seed, (R,), with a 95 % interval if there are several."""
    if len(values) < 2 or np.isnan(values).any():
        return float(values.mean())
    rng = np.random.default_rng(0)
    return bootstrap(values[:, None], mean, rng, draws=DRAWS, resample="rows")


def table(found: dict[str, dict[int, GridScores]]) -> Table:
    """Return a line for each row that was run."""
    made = Table(("policy", "seeds", "training steps", "whole grid", "inside", "outside"))
    for name, row in {**EVALUATIONS, **UNTOUCHED}.items():
        runs = found.get(row.training if row.before else name, {})
        if runs:
            columns = np.array([means(one, row.before) for one in runs.values()])  # (R, 3)
            steps = float(np.mean([one.frames[0] for one in runs.values()]))
            made.add(row.text, len(runs), steps, *(over_seeds(c) for c in columns.T))
    return made


def verdicts(found: dict[str, dict[int, GridScores]]) -> list[str]:
    """Return the claims, decided on the seeds that both sides have."""
    said = []
    pairs = (
        ("oracle", lambda own, other: own / other, f"at least {SHARE} of the oracle", SHARE),
        ("esmaml", lambda own, other: own - other, "above ES-MAML after hill climbing", 0.0),
        ("climb", lambda own, other: own - other, "above the same policy, hill climbing", 0.0),
    )
    for rival, compare, words, bound in pairs:
        both = sorted(set(found.get("identify", {})) & set(found.get(rival, {})))
        if not both:
            said.append(f"`identify` is {words}: not run.")
            continue
        sides = [np.mean([found[name][s].frames[0] for s in both]) for name in ("identify", rival)]
        if abs(sides[1] - sides[0]) > NEAR * max(sides):
            said.append(
                f"`identify` is {words}: not decided, {sides[0]:.2g} steps of training against "
                f"{sides[1]:.2g}."
            )
            continue
        numbers = [compare(means(found["identify"][s])[0], means(found[rival][s])[0]) for s in both]
        value = over_seeds(np.array(numbers))
        if not isinstance(value, Interval):
            text, word = f"{value:.3g} on one seed", "undecided, one seed has no interval"
        else:
            text = f"{value.value:.3g} [{value.low:.3g}, {value.high:.3g}] on {len(both)} seeds"
            word = "holds" if value.low >= bound else "undecided"
            word = "contradicted" if value.high < bound else word
        said.append(f"`identify` is {words}: {word}; {text}.")
    return said


def draw(found: dict[str, dict[int, GridScores]], path: Path) -> None:
    """Draw each row's mean return over the grid, a point a seed."""
    rows = [(name, row) for name, row in EVALUATIONS.items() if name in found]
    with figure(path, 1, 1, (7.0, 1.0 + 0.45 * len(rows))) as (_, axes):
        panel = axes[0, 0]
        for place, (name, row) in enumerate(rows):
            values = [means(one)[0] for one in found[name].values()]
            panel.plot(values, [place] * len(values), "o", color=COLOURS[0], alpha=0.6)
            panel.plot([np.mean(values)], [place], "|", color=INK, ms=18)
            panel.text(
                0.0, place + 0.32, row.text, fontsize=8, transform=panel.get_yaxis_transform()
            )
        panel.set_yticks([])
        panel.set_ylim(len(rows) - 0.5, -0.6)
        panel.set_xlabel(
            "mean return over the grid (a point is a training seed, the bar their mean)"
        )


def report(plan: Plan) -> bool:
    """Write table and picture of the runs that are there; return whether there are any."""
    found = read(plan)
    if not found:
        print(f"no scores in {plan.out}; start without --report", file=sys.stderr)
        return False
    made, some = table(found), next(iter(next(iter(found.values())).values()))
    made.notes += verdicts(found)
    made.notes.append(
        f"Mean return over {some.grid.size} Hoppers (torso mass by ground friction); training drew "
        "from the range inside. Intervals: 95 %, bootstrap over training seeds; so few make them "
        "too narrow. The student's steps are beside those of its teacher. Claims are decided by "
        "the interval of the paired seeds over the whole grid."
    )
    cells = " ".join(map(str, plan.cells))
    made.notes.append(
        f"Made by `python -m benchmarks.conditioned --frames {plan.frames} --cells {cells}`, a run "
        "that had more steps counted as it was."
    )
    made.write(plan.results / "conditioned", title="Policies that know their robot")
    draw(found, plan.results / "conditioned.png")
    return True


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.conditioned",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add, every = parser.add_argument, list(EVALUATIONS)
    add("--rows", nargs="+", default=every, choices=every, metavar="ROW", help=", ".join(every))
    add("--seeds", type=int, nargs="+", default=list(range(5)), help="training seeds")
    add("--frames", type=int, default=FRAMES, help="environment steps of each training")
    add("--cells", type=int, nargs=2, default=[12, 15], help="masses and frictions of the grid")
    add("--report", action="store_true", help="run nothing, write the table of what there is")
    out = Path("outputs/bench_long/conditioned")
    add("--out", type=Path, default=out, help="folder of the runs")
    add("--results", type=Path, default=RESULTS, help="folder of the table")
    chosen = parser.parse_args(arguments)
    plan = Plan(
        tuple(chosen.rows),
        tuple(chosen.seeds),
        chosen.frames,
        tuple(chosen.cells),
        chosen.out.resolve(),
        chosen.results.resolve(),
    )
    if chosen.report:
        return int(not report(plan))
    failed = [(r, s) for s in plan.seeds for r in plan.rows if not evaluate(plan, r, s)]
    return int(not report(plan) or bool(failed))


if __name__ == "__main__":
    sys.exit(main())
