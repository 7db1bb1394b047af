"""Three episodes of identification beside fifty of hill climbing, on an emulated walking robot.

    python -m benchmarks.told                       # 5 seeds: an hour on 2 cores
    python -m benchmarks.told --seeds 0 1
    python -m benchmarks.told --report              # the table of what there is

A policy of quad8 is trained on robots that differ, and told how (`transforms=with_params`). On the
emulated bus, on robots that hide a load and a low supply, or a slippery ground, it is told what
three episodes' logs say (`adapt=identify`), or climbs by the returns of fifty (`adapt=batch`, told
the middle of the ranges). Starts are the same; five episodes before and five after. What is
complete is not run again.
"""

from __future__ import annotations

import argparse
import csv
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.robots import CLIMB, SHIFTS, TRIALS, mean, phases
from benchmarks.study import claimed, sim2real, trained
from hardware.errors import HardwareError
from sim2real.config.compose import compose, prepare
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval, bootstrap
from sim2real.runs.statistics import mean as average
from sim2real.runs.tables import Table

RESULTS = Path(__file__).parent / "results"
ROBOT, NAME, DRAWS = "quad8", "told", 10_000
TRAINING = (
    *("+experiment=quad8_es", "params=quad8_dr", "transforms=with_params", "iterations=160"),
    "params.draws.9.low=0.2",  # ground friction: what is not trained cannot be told
    *("eval=none", "video=none", "keep_checkpoints=1"),
)
WAYS = {"identify": ("adapt=identify",), "climb": CLIMB}
WORDS = {
    "identify": "told what 3 episodes' logs say",
    "climb": "50 episodes of hill climbing",
}


def policy(out: Path, seed: int) -> Path | None:
    """Return a trained policy's run; None where it failed."""
    folder = out / f"seed{seed}" / "policy"
    begun = trained(folder)
    if not (folder / "done").is_file():
        go_on = [f"resume={folder}"] if begun else []
        if not sim2real(*TRAINING, f"seed={seed}", f"hydra.run.dir={folder}", *go_on):
            return None
        write_text(folder / "done", "")
    return folder


def ride(out: Path, seed: int, way: str, shift: str) -> bool:
    """Run a policy on the emulated bus, adapting; return whether it came to its end."""
    folder = out / f"seed{seed}" / f"{way}_{shift}"
    if (folder / "table.csv").is_file():
        return True
    shutil.rmtree(folder, ignore_errors=True)
    words = [
        "run=deploy",
        f"checkpoint={out / f'seed{seed}' / 'policy'}",
        f"robot={ROBOT}",
        f"robot.hidden=conf/shift/{SHIFTS[ROBOT][shift]}.yaml",
        f"trials={TRIALS}",
        f"seed={seed}",
        "stops={odd_voltage: 0.4, stray: 2.0}",  # a lower supply and legs that give are no faults
        *WAYS[way],
    ]
    try:
        verb, arguments = prepare(compose(words), folder)
        verb(**arguments)
    except (Sim2RealError, HardwareError) as error:
        print(f"{folder}: {error}", file=sys.stderr)
        return False
    return True


def run(out: Path, seeds: Sequence[int], results: Path) -> int:
    """Do all that is not done yet; return how many jobs failed."""
    failed = 0
    for seed in seeds:
        with claimed(out / f"seed{seed}") as mine:
            if not mine:
                continue
            if policy(out, seed) is None:
                failed += 1
                continue
            for shift in SHIFTS[ROBOT]:
                failed += sum(not ride(out, seed, way, shift) for way in WAYS)
        report(out, seeds, results)
    return failed


def found(out: Path, seeds: Sequence[int]) -> list[dict[str, str | float]]:
    """Return a row a deployment."""
    rows: list[dict[str, str | float]] = []
    for seed in seeds:
        for shift in SHIFTS[ROBOT]:
            for way in WAYS:
                told = phases(out / f"seed{seed}" / f"{way}_{shift}")
                if told:
                    before, after = mean(told["as trained"]), mean(told["adapted"])
                    spent = len(told["adapting"])
                    numbers = {"before": before, "after": after, "episodes": float(spent)}
                    rows.append({"shift": shift, "seed": float(seed), "way": way, **numbers})
    return rows


def report(out: Path, seeds: Sequence[int], results: Path) -> str:
    """Write the CSV and the table; return the table."""
    rows = found(out, seeds)
    results.mkdir(parents=True, exist_ok=True)
    with (results / f"{NAME}.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, ["shift", "seed", "way", "before", "after", "episodes"])
        writer.writeheader()
        writer.writerows(rows)
    made = Table(["hidden", "adaptation", "seeds", "before", "after", "gain"])
    for shift in SHIFTS[ROBOT]:
        for way, words in WORDS.items():
            own = [r for r in rows if r["shift"] == shift and r["way"] == way]
            if own:
                before, after = (np.array([float(r[k]) for r in own]) for k in ("before", "after"))
                made.add(shift, words, len(own), *map(about, (before, after, after - before)))
    made.notes.append(
        f"`python -m benchmarks.told`: returns of {ROBOT} on its emulated bus, means of {TRIALS} "
        "episodes, then over training seeds, with 95 % bootstrap intervals over seeds."
    )
    write_text(results / f"{NAME}.md", made.markdown())
    return made.markdown()


def about(values: np.ndarray) -> Interval | float:
    """Return the mean over seeds and its interval."""
    if len(values) < 2:
        return float(values[0])
    return bootstrap(
        values[:, None], average, np.random.default_rng(0), draws=DRAWS, resample="rows"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.told",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--seeds", type=int, nargs="+", default=[0, 1, 2, 3, 4], help="training seeds")
    add("--report", action="store_true", help="run nothing, write the table")
    add("--out", type=Path, default=Path("outputs/bench_long") / NAME, help="folder of the runs")
    add("--results", type=Path, default=RESULTS, help="folder of the table")
    chosen = parser.parse_args(arguments)
    out, seeds = chosen.out.resolve(), list(dict.fromkeys(chosen.seeds))
    failed = 0 if chosen.report else run(out, seeds, chosen.results)
    print(report(out, seeds, chosen.results))
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
