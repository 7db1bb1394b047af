"""Does screening's glance in longer time steps keep the ranking of candidates?

    python -m benchmarks.screening                 # 100 cases: hours; goes on where it was stopped
    python -m benchmarks.screening --cases 20 --seed 77
    python -m benchmarks.screening --only 0 38     # of the hundred these two
    python -m benchmarks.screening --most 0        # the table of what is done so far

Each case is made as the exam makes it; its candidates are screened with every probe simulated as
it is, and with the glance. The table says how many of the exact first five keep their places, how
often the first one is the same, with 95 % intervals of resampled cases, and what the glance saves
of the physics steps. Whether the first one is a hidden effect is compared by McNemar's exact test.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from hardware.log import read_log
from sim2real.diagnosis.attribution.attribute import Search
from sim2real.diagnosis.attribution.candidates import candidates
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.attribution.screen import screen
from sim2real.diagnosis.attribution.suspects import suspects
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.noise_floor import noise_floor, rounding
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.exam.cases import Exam, Outline
from sim2real.runs.files import claimed, write_text
from sim2real.runs.statistics import Interval
from sim2real.runs.tables import Table

RESULTS = Path(__file__).parent / "results"
OUT = Path("outputs/bench_long/screening")
ROBOTS = ("bench1", "hopper2", "quad8", "arm6")
WAYS = ("exact", "glance")
FIRST = 5  # places that are to be kept
DRAWS, TAIL = 2000, 0.025  # of the resampled cases: a 95 % interval


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line, screen what is left of the cases and keep the table."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.screening",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--cases", type=int, default=100, help="of the exam (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=77, help="of their draw (default: %(default)s)")
    parser.add_argument("--only", type=int, nargs="+", help="numbers of the cases, if not all")
    parser.add_argument("--most", type=int, help="cases to screen now; 0 writes the table only")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of the cases' results")
    parser.add_argument("--results", type=Path, default=RESULTS, help="folder of what is kept")
    chosen = parser.parse_args(arguments)
    if chosen.cases < 1 or (chosen.most or 0) < 0:
        parser.error("--cases must be at least 1, and --most not negative")
    if not set(chosen.only or ()) <= set(range(chosen.cases)):
        parser.error(
            f"--only {chosen.only} must lie between 0 and {chosen.cases - 1}, below --cases"
        )
    exam = Exam(ROBOTS, one=1, two=8, none=0, excluded=0, longest=1.0, block=1, sample=chosen.cases)
    drawn = exam.draw(chosen.seed)
    asked = drawn if chosen.only is None else [drawn[number] for number in chosen.only]
    left = [one for one in asked if not _file(chosen, one).is_file()]
    for outline in left[: chosen.most]:
        with claimed(chosen.out / "claims" / f"{chosen.seed}_{outline.name}") as mine:
            if mine and not _file(chosen, outline).is_file():
                told = compare(exam, outline)
                write_text(_file(chosen, outline), json.dumps(told, indent=1) + "\n")
    files = sorted(chosen.out.glob(f"{chosen.seed}_*.json"))
    found = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    cases = [case for case in found if case]
    if not cases:
        print("no case was screened so far", file=sys.stderr)
        return 1
    made = table(cases, np.random.default_rng(chosen.seed))
    made.notes.append(f"{len(cases)} cases of seed {chosen.seed}, of {chosen.cases} drawn.")
    made.write(chosen.results / "screening")
    print(made.markdown())
    return 0


def _file(chosen: argparse.Namespace, outline: Outline) -> Path:
    return chosen.out / f"{chosen.seed}_{outline.name}.json"


def compare(exam: Exam, outline: Outline) -> dict[str, Any]:
    """Screen a case both ways; nothing where its robot cannot show the effect."""
    with tempfile.TemporaryDirectory() as folder:
        logs, key = Path(folder) / "logs", Path(folder) / "key"
        for each in (logs, key):
            each.mkdir()
        if not exam.make(outline, logs, key):
            return {}
        data = Data.of([read_log(file) for file in sorted(logs.glob("*.csv"))])
        told = screened(data, np.random.default_rng(outline.seed))
    return {"robot": outline.robot, "effects": list(outline.effects), **told}


def screened(data: Data, rng: np.random.Generator) -> dict[str, Any]:
    """Return the first candidates and the physics steps of both ways to screen them."""
    floors = noise_floor(data.logs, data.settings)
    least = [max(floors.get(j.name, 0.0), rounding(j.count)) / j.scale for j in data.joints]
    problem = Problem(data, Simulator(data))
    floor = float(np.sqrt(np.mean(np.square(least))))
    search = Search(problem, candidates(data), floor, rng, lambda text, share: None)
    options, looked = suspects(search, search.none, search.base), search.screening
    promise, found = data.settings.search.promise_first, {}
    coarse = None if search.coarse is None else looked.by(search.coarse)
    for name, glance in (("exact", None), ("glance", coarse)):
        before = search.work.total
        guesses = screen(looked, search.none, options, (), glance).guesses
        steps = search.work.total - before
        first = [g.candidate.label for g in guesses if g.gain > promise][:FIRST]
        found |= {name: first, f"{name}_steps": steps}
    return {"candidates": len(options), **found}


def table(cases: Sequence[dict[str, Any]], rng: np.random.Generator) -> Table:
    """Return what the cases come to, with intervals of resampled cases."""
    pairs = [(case["exact"], [*case["glance"], *[None] * FIRST]) for case in cases]
    kept = np.array([sum(a == b for a, b in zip(*pair, strict=False)) for pair in pairs], float)
    told = np.array([len(exact) for exact, _ in pairs], float)
    first = np.array([not exact or exact[0] == glance[0] for exact, glance in pairs], float)
    steps = [np.array([case[f"{way}_steps"] for case in cases], float) for way in WAYS]
    draws = rng.integers(len(cases), size=(DRAWS, len(cases)))
    made = Table(("figure", "value"))
    rows = {
        "of the first five, in their places": (kept, told),
        "first one the same": (first, np.ones_like(first)),
        "physics steps, exact over glance": (steps[0], steps[1]),
    }
    for name, (values, counts) in rows.items():
        means = values[draws].sum(axis=1) / np.maximum(counts[draws].sum(axis=1), 1)
        low, high = np.quantile(means, (TAIL, 1 - TAIL))
        mean = float(values.sum() / max(counts.sum(), 1))
        made.add(name, Interval(mean, float(low), float(high)))
    right = [np.array([_is_right(case, way) for case in cases]) for way in WAYS]
    alone = [int((right[i] & ~right[1 - i]).sum()) for i in (0, 1)]
    chance = float(binomtest(alone[0], sum(alone)).pvalue) if any(alone) else 1.0
    made.notes.append(
        f"The first one is a hidden effect by the exact screening alone in {alone[0]} cases, by "
        f"the one with the glance alone in {alone[1]}; McNemar's exact test: p = {chance:.3g}."
    )
    return made


def _is_right(case: dict[str, Any], way: str) -> bool:
    return bool(case[way]) and case[way][0].split(".")[0].split(" (")[0] in case["effects"]


if __name__ == "__main__":
    sys.exit(main())
