"""Which parameters can be found: the cart-pole's length, and what no motion tells.

On a cart-pole of which nothing absolute is left (conf/shift/cartpole_bare.yaml) masses, gains and
dampings scale together: motion tells their ratios, and the length of the pole. Each seed has its
own demonstrations, of the first training's policy.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from benchmarks.easi.plan import Plan, within
from benchmarks.easi.steps import demonstrated, evaluated, identify
from envs.distribution import Distribution
from envs.distribution_file import read
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

PARAMS, EFFECTS = "cartpole_six", "conf/shift/cartpole_bare.yaml"
LENGTH, GAIN = "link_length.pole", "position_gain.slider"
SCALED = 5  # parameters that scale together
FLAT = 0.9  # cosine: a direction this near to that of the common scale is it
METHODS: dict[str, tuple[int, tuple[str, ...]]] = {  # trajectories, and settings
    "one_step": (3, ("identify=cma", "identify/score=one_step", "identify.search.generations=60")),
    "critic_gp": (50, ("identify=easi",)),
}
SHARES = {"one_step": 0.02, "critic_gp": 0.1}  # of the length, within which an estimate should be


def run(plan: Plan) -> int:
    """Run what is not yet done; return how many runs failed."""
    failed, policy = 0, plan.folder(0, "udr")
    if not evaluated(policy, None):
        return 1
    for method, (budget, words) in METHODS.items():
        for seed in plan.seeds:
            folder = plan.folder(seed, f"six_{method}")
            place = plan.folder(seed, f"six_demonstrations_{budget}")
            log = demonstrated(place, policy, budget, seed, EFFECTS)
            given = (f"params={PARAMS}", f"effects={EFFECTS}", *words, *plan.identify)
            if "identify=easi" in words:
                given = (*given, f"checkpoint={policy}")
            failed += identify(plan, folder, log, seed, given) is None
    report(plan)
    return failed


def report(plan: Plan) -> None:
    """Write easi_parameters.csv and .md of all runs that are complete."""
    lines, found = [], dict[str, dict[int, Distribution]]()
    for method in METHODS:
        for file in sorted((plan.out / plan.name).glob(f"seed*/six_{method}/distribution.yaml")):
            seed, one = int(file.parts[-3].removeprefix("seed")), read(file)
            found.setdefault(method, {})[seed] = one
            lines += rows(method, seed, one)
    if not lines:
        return
    table = Table(("method", "seed", "parameter", "mean", "std", "target", "common scale is flat"))
    for line in lines:
        table.add(*line)
    plan.results.mkdir(parents=True, exist_ok=True)
    write_text(plan.results / "easi_parameters.csv", table.csv())
    write_text(plan.results / "easi_parameters.md", markdown(found))


def rows(method: str, seed: int, one: Distribution) -> list[tuple]:
    """Return a line for each parameter, and for each ratio to the drive's stiffness."""
    flat, mean = scale_is_flat(one), dict(zip(one.names, one.mean, strict=True))
    lines: list[tuple] = [
        (method, seed, name, float(mean[name]), float(std), 1.0, flat)
        for name, std in zip(one.names, one.std, strict=True)
    ]
    for name in one.names:
        if name not in (LENGTH, GAIN):
            ratio = float(mean[name] / mean[GAIN])
            lines.append((method, seed, f"{name} / {GAIN}", ratio, None, 1.0, flat))
    return lines


def scale_is_flat(one: Distribution) -> str:
    """Return whether the common scale of masses, gains and dampings stands under `flat`.

    "–" for a method that names no directions.
    """
    if one.made_by.get("method") != "matching":
        return "–"
    wanted = {name: SCALED**-0.5 for name in one.names if name != LENGTH}
    near = [sum(flat.parameters.get(n, 0.0) * w for n, w in wanted.items()) for flat in one.flat]
    return "yes" if max(np.abs([*near, 0.0])) >= FLAT else "no"


def markdown(found: dict[str, dict[int, Distribution]]) -> str:
    """Return the table for people."""
    columns = ("parameter", "method", "seeds", "median", "least", "largest", "within")
    table = Table(columns)
    for method, every in found.items():
        lines = [rows(method, seed, one) for seed, one in every.items()]
        for number, first in enumerate(lines[0]):
            values = np.array([line[number][3] for line in lines])
            share = SHARES[method]
            count = f"{within(values, 1.0, share)} of {len(values)} within {share:.0%}"
            numbers = (float(np.median(values)), float(values.min()), float(values.max()))
            table.add(first[2], method, len(values), *numbers, count)
    flats = [scale_is_flat(one) for one in found.get("one_step", {}).values()]
    text = [
        "# Which parameters motion tells",
        "",
        "Estimates over the target's values on a cart-pole whose masses, gains and dampings scale "
        "together without a trace (`conf/shift/cartpole_bare.yaml`), from a third to three times "
        "the target: three demonstrations for one_step, fifty for critic_gp. "
        "`python -m benchmarks.easi --parameters --seeds 0 1 2 3 4 5 6 7 8 9`",
        "",
        table.markdown(),
        f"The common scale stands under `flat` in {flats.count('yes')} of {len(flats)} answers of "
        "one_step. A critic's answer names no directions: what it says of masses and gains is "
        "where its population stopped, and only the ratios mean something.",
    ]
    return "\n".join(text) + "\n"


def histories(folder: Path) -> np.ndarray | None:
    """Return mean and deviation of each generation's points, (G, 2, P); None without a journal."""
    file = folder / "journal.npz"
    if not file.is_file():
        return None
    with np.load(file, allow_pickle=False) as arrays:
        count = len([name for name in arrays.files if name.startswith("asked.")])
        asked = [arrays[f"asked.{i}"] for i in range(count)]
    return np.array([(points.mean(axis=0), points.std(axis=0)) for points in asked])


def read_csv(path: Path) -> list[dict[str, str]]:
    """Return the rows of a table; none if it is not there."""
    if not path.is_file():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))
