"""Does training in a corrected simulator close the gap that separates two Hoppers?

    python -m benchmarks.hopper_gap                          # 10 seeds: an hour on a free core
    python -m benchmarks.hopper_gap --seeds 0 1 2
    python -m benchmarks.hopper_gap --report                 # the table of what there is

`+experiment=hopper_gap` diagnoses the source simulator from ten episodes of the target. PPO is then
trained in the source, on the target, and in the source with what the diagnosis found, with the same
settings and steps, and every last policy plays 50 episodes on the target. What is closed of the gap
is (corrected - source) / (target - source), by interquartile means over the seeds.

The runs in the source and on the target are those of the transfer study: --runs names their folder,
and whichever of both programs comes first does the work. What is complete is skipped, what was
interrupted is continued, and several of these programs may run at once.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks import real_logs, study
from benchmarks.study import Row
from benchmarks.transfer import LONG, STUDY
from envs.effects import load_effects
from sim2real.evaluation.transfer import TransferScores, read
from sim2real.runs.figures import COLOURS, INK, figure
from sim2real.runs.statistics import bootstrap, iqm, share_closed
from sim2real.runs.tables import Table

RESULTS = Path(__file__).parent / "results"
DRAWS = 10_000  # resamples of an interval
FEW = 2  # runs without which there is no interval
WORDS = {"source": "the source", "corrected": "the corrected source", "target": "the target"}


@dataclass(frozen=True)
class Plan:
    """What to train and where.

    Args:
        seeds: of training.
        runs: folder of the runs in the source and on the target.
        out: folder of the diagnosis and of the runs in the corrected source.
        results: folder of the table and the picture.
        frames: environment steps of every run.
        overrides: further settings of every run.
    """

    seeds: tuple[int, ...]
    runs: Path
    out: Path
    results: Path
    frames: int = LONG
    overrides: tuple[str, ...] = ()

    @property
    def effects(self) -> Path:
        """What the diagnosis found."""
        return self.out / "diagnosis" / "effects.yaml"

    def folder(self, name: str, seed: int) -> Path:
        """Return a run's folder."""
        return (self.out if name == "corrected" else self.runs) / name / f"seed{seed}"

    def job(self, name: str) -> tuple[study.Plan, Row]:
        """Return how such a run is trained: the plan and row of a study, the transfer study's."""
        row = corrected(self.effects) if name == "corrected" else STUDY.rows[name]
        out = self.out if name == "corrected" else self.runs
        frames = None if self.frames == LONG else self.frames
        more = (out, self.results, frames, self.overrides)
        return study.Plan(((row,),), (name,), self.seeds, *more), row


def corrected(effects: Path) -> Row:
    """Return the row of the runs in the source with what was found."""
    return replace(
        STUDY.rows["source"], name="corrected", budgets=(LONG,), overrides=(f"effects={effects}",)
    )


def run(plan: Plan) -> int:
    """Diagnose, train all that is not yet trained, seed by seed, and write the table after each.

    Returns:
        How many jobs failed; the others went on.
    """
    if not plan.effects.is_file():
        folder = plan.effects.parent
        if not study.sim2real("+experiment=hopper_gap", f"hydra.run.dir={folder}"):
            return 1
    failed = 0
    for seed in plan.seeds:
        for name in WORDS:
            failed += study.train(*plan.job(name), seed) is False
        report(plan)
    return failed


def scores(plan: Plan, name: str) -> dict[int, TransferScores]:
    """Return the scores of the runs that are complete, by seed."""
    found = {}
    for seed in plan.seeds:
        files = {
            int(file.stem.rpartition("-")[2]): file
            for file in plan.folder(name, seed).glob("transfer-*.json")
        }
        whole = [steps for steps in files if steps >= plan.frames]
        if whole:
            (found[seed],) = read(files[min(whole)])
    return found


def report(plan: Plan) -> Table | None:
    """Write hopper_gap.md, .csv and .png; None until every simulator has two runs."""
    found = {name: scores(plan, name) for name in WORDS}
    if min(map(len, found.values())) < FEW:
        return None
    on_target = {
        name: np.array([[one.returns["target"].mean()] for one in runs.values()])
        for name, runs in found.items()
    }
    rng = np.random.default_rng(0)
    table = Table(("trained in", "runs", "return on the target (IQM)", "closed"))
    closed = share_closed(
        on_target["source"], on_target["corrected"], on_target["target"], iqm, rng, draws=DRAWS
    )
    for name, returns in on_target.items():
        middle = bootstrap(returns, iqm, rng, draws=DRAWS, resample="rows")
        table.add(WORDS[name], len(returns), middle, closed if name == "corrected" else None)
    table.notes += _notes(plan, found)
    table.write(
        plan.results / "hopper_gap", "Hopper: the gap that training in the corrected source closes"
    )
    each = Table(("trained in", "seed", "training steps", "return on the target"))
    for name, runs in found.items():
        for seed, one in runs.items():
            each.add(WORDS[name], seed, one.frames, float(one.returns["target"].mean()))
    (plan.results / "hopper_gap_runs.csv").write_text(each.csv(), encoding="utf-8")
    draw(on_target, plan.results / "hopper_gap.png")
    return table


def _notes(plan: Plan, found: dict[str, dict[int, TransferScores]]) -> list[str]:
    """Return what stands below the table: what was diagnosed, how it was measured, what is left."""
    answer = json.loads((plan.effects.parent / "report.json").read_text(encoding="utf-8"))
    named = ", ".join(
        f"{effect.label()} {values[0]:+.5g}" for effect, values in load_effects(plan.effects)
    )
    intervals = "; ".join(
        "{} {:.5g} to {:.5g} {}".format(cause["effect"], *cause["value_ci"], cause["unit"])
        for cause in real_logs.values(answer)
    )
    notes = [
        f"The diagnosis of ten episodes of the target: {named} (90 % interval {intervals}); the "
        "target's torso weighs 1 kg more than the source's.",
        "A run is the mean of 50 deterministic episodes of its last policy. closed = (corrected - "
        "source) / (target - source). Brackets: 95 %, bootstrap over the runs of each row.",
    ]
    lacking = [len(plan.seeds) - len(runs) for runs in found.values()]
    if any(lacking):
        notes.append(f"PARTIAL: {sum(lacking)} of {len(plan.seeds) * len(found)} runs are missing.")
    return notes


def draw(returns: dict[str, np.ndarray], path: Path) -> None:
    """Draw each run's return on the target, interquartile means and their 95 % intervals."""
    with figure(path, 1, 1, (5.4, 3.2)) as (_, axes):
        panel = axes[0, 0]
        for place, values in enumerate(returns.values()):
            spread = np.linspace(-0.16, 0.16, len(values))
            panel.plot(place + spread, values[:, 0], "o", color=COLOURS[place], alpha=0.7)
            told = bootstrap(values, iqm, np.random.default_rng(0), draws=DRAWS, resample="rows")
            panel.hlines(told.value, place - 0.3, place + 0.3, color=INK, lw=2)
            panel.vlines(place, told.low, told.high, color=INK, lw=1.2)
        panel.set_xticks(range(len(returns)), [f"trained in\n{WORDS[name]}" for name in returns])
        panel.set_ylabel("return of an episode on the target\n(dots: runs; lines: IQM, 95 %)")
        panel.set_ylim(bottom=0)
        panel.grid(axis="y")


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.hopper_gap",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add, long = parser.add_argument, Path("outputs/bench_long")
    add("--seeds", type=int, nargs="+", default=list(range(10)), help="default: 0 to 9")
    add(
        "--frames", type=int, default=LONG, help="environment steps of a run (default: %(default)s)"
    )
    add("--report", action="store_true", help="train nothing, write the table")
    add("--runs", type=Path, default=long / "transfer", help="folder of the transfer study's runs")
    add("--out", type=Path, default=long / "hopper_gap", help="folder of the other runs")
    add("--results", type=Path, default=RESULTS, help="folder of the table and the picture")
    add("--set", nargs="*", default=[], metavar="KEY=VALUE", help="further settings of every run")
    chosen = parser.parse_args(arguments)
    if min(chosen.seeds) < 0 or chosen.frames < 1:
        parser.error("--seeds must not be negative and --frames at least 1")
    plan = Plan(
        tuple(dict.fromkeys(chosen.seeds)),
        chosen.runs.resolve(),
        chosen.out.resolve(),
        chosen.results.resolve(),
        chosen.frames,
        tuple(chosen.set),
    )
    if not chosen.report:
        return int(run(plan) > 0)
    if report(plan) is None:
        print("no table yet: every simulator needs two complete runs", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
