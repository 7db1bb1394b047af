"""How much of a servo robot's gap closes by learning anew in the simulator that was diagnosed?

    python -m benchmarks.robot_gap                          # 5 seeds: half an hour on two cores
    python -m benchmarks.robot_gap --seeds 0 1
    python -m benchmarks.robot_gap --report                 # the table of what there is

Runs `+experiment=hopper2_gap` once for each seed: a policy learned in the simulator as it is, one
in the simulator with what a diagnosis of the robot's own recordings found, and one with what the
robot really hides, all three on the emulated robot. What is closed of the gap is (found - as given)
/ (hidden - as given), returns on the robot, by interquartile means over the seeds.

A run goes on where it stopped, and a complete one is skipped.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks import study
from sim2real.loops.relearn import CORRECTED, NOMINAL, RESULT, TRUTH, WORDS, Tried, draw
from sim2real.runs.files import claimed
from sim2real.runs.statistics import bootstrap, iqm, share_closed
from sim2real.runs.tables import Table

RESULTS = Path(__file__).parent / "results"
DRAWS = 10_000  # resamples of an interval
FEW = 2  # runs without which there is no interval


@dataclass(frozen=True)
class Plan:
    """What to run and where.

    Args:
        seeds: of the runs.
        out: their folder.
        results: folder of the table and the picture.
        overrides: further settings of every run.
    """

    seeds: tuple[int, ...]
    out: Path
    results: Path
    overrides: tuple[str, ...] = ()

    def folder(self, seed: int) -> Path:
        """Return a run's folder."""
        return self.out / f"seed{seed}"


def run(plan: Plan) -> int:
    """Run the seeds that are not complete, write the table after each; return how many failed."""
    failed = 0
    for seed in plan.seeds:
        folder = plan.folder(seed)
        with claimed(folder) as mine:
            if mine and not (folder / RESULT).is_file():
                where = (f"hydra.run.dir={folder}", f"resume={folder}")
                line = ("+experiment=hopper2_gap", f"seed={seed}", *where, *plan.overrides)
                failed += not study.sim2real(*line)
        report(plan)
    return failed


def collect(plan: Plan) -> dict[int, dict]:
    """Return what each complete run found and earned, by seed."""
    files = {seed: plan.folder(seed) / RESULT for seed in plan.seeds}
    return {
        seed: json.loads(file.read_text(encoding="utf-8"))
        for seed, file in files.items()
        if file.is_file()
    }


def report(plan: Plan) -> Table | None:
    """Write robot_gap.md, .csv, .png and robot_gap_runs.csv; None before there are two runs."""
    found = collect(plan)
    if len(found) < FEW:
        return None
    tried = {
        name: [Tried(**run["policies"][name]) for run in found.values()]
        for name in (NOMINAL, CORRECTED, TRUTH)
    }
    at_home = {name: _means([one.simulator for one in runs]) for name, runs in tried.items()}
    on_robot = {name: _means([one.robot for one in runs]) for name, runs in tried.items()}
    rng = np.random.default_rng(0)
    before, after, best = on_robot.values()
    closed = share_closed(before, after, best, iqm, rng, draws=DRAWS)
    table = Table(("learned in the simulator", "runs", "return there", "on the robot", "closed"))
    for name, returns in on_robot.items():
        here, there = (
            bootstrap(values, iqm, rng, draws=DRAWS, resample="rows")
            for values in (at_home[name], returns)
        )
        share = closed if name == CORRECTED else None
        table.add(WORDS[name], len(returns), here, there, share)
    episodes = len(tried[NOMINAL][0].robot)
    table.notes += [
        f"Interquartile means over runs, each the mean of {episodes} episodes. closed = (with what "
        "was found - as given) / (with what is hidden - as given), on the robot. Brackets: 95 %, "
        "bootstrap over the runs of each row.",
        "Found: " + "; ".join(f"seed {seed}: {run['found']}" for seed, run in found.items()) + ".",
    ]
    if len(found) < len(plan.seeds):
        missing = len(plan.seeds) - len(found)
        table.notes.append(f"PARTIAL: {missing} of {len(plan.seeds)} runs are missing.")
    table.write(plan.results / "robot_gap", "hopper2: the gap before and after")
    each = Table(("seed", "learned in the simulator", "return there", "return on the robot"))
    for place, seed in enumerate(found):
        for name in tried:
            each.add(seed, WORDS[name], *(float(r[name][place, 0]) for r in (at_home, on_robot)))
    (plan.results / "robot_gap_runs.csv").write_text(each.csv(), encoding="utf-8")
    draw(tried, plan.results / "robot_gap.png")
    return table


def _means(runs: list[list[float]]) -> np.ndarray:
    """Return each run's mean, (n, 1)."""
    return np.array([[np.mean(episodes)] for episodes in runs])


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.robot_gap",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add, out = parser.add_argument, Path("outputs/bench_long/robot_gap")
    add("--seeds", type=int, nargs="+", default=list(range(5)), help="default: 0 to 4")
    add("--report", action="store_true", help="run nothing, write the table")
    add("--out", type=Path, default=out, help="folder of the runs")
    add("--results", type=Path, default=RESULTS, help="folder of the table and the picture")
    add("--set", nargs="*", default=[], metavar="KEY=VALUE", help="further settings of every run")
    chosen = parser.parse_args(arguments)
    if min(chosen.seeds) < 0:
        parser.error("--seeds must not be negative")
    seeds = tuple(dict.fromkeys(chosen.seeds))
    plan = Plan(seeds, chosen.out.resolve(), chosen.results.resolve(), tuple(chosen.set))
    if not chosen.report:
        return int(run(plan) > 0)
    if report(plan) is None:
        print("no table yet: there must be two complete runs", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
