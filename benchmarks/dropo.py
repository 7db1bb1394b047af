"""DROPO on the Hopper of the transfer studies: does it find the target, and what is that worth?

    python -m benchmarks.dropo                      # 10 seeds: an hour and a half on 2 cores
    python -m benchmarks.dropo --seeds 0 1
    python -m benchmarks.dropo --report             # the tables of what there is
    SIM2REAL_DATA=... python -m benchmarks.dropo --public   # the public transitions too

A half-trained policy of the source (its torso is 1 kg too light) acts for some episodes on the
target. DROPO identifies four masses from these transitions, and PPO is trained on robots that are
drawn from its answer. The returns on the target stand beside those that `benchmarks.transfer` has
of randomization and of policies trained on the target, with the same settings. What is complete is
not run again; several of these programs share the work.

The public transitions are those of DROPO's authors, of the target on an older engine.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.easi.demonstrations import demonstrate
from benchmarks.study import claimed, sim2real, trained
from envs.distribution import Distribution, Entry
from envs.distribution_file import read, write
from envs.effects import make
from envs.laws import uniform
from envs.models import named
from envs.tasks import HopperPolito
from hardware.log import Log, write_log
from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval, bootstrap, iqm
from sim2real.runs.tables import Table

RESULTS = Path(__file__).parent / "results"
NAME, DRAWS = "dropo", 10_000
BODIES = ("torso", "thigh", "leg", "foot")
LIGHTER = 1.0  # kg that the source's torso lacks
LOW, HIGH = 0.5, 1.5  # factors on the source's masses that the prior holds
EPISODES, HALF_TRAINED, STEPS = 10, 200_000, 500_000
NINETY = 1.645  # standard deviations to either side that hold 90 %
SEARCH = (  # a tenth of DROPO's usual cost
    *("identify=dropo", "identify.transitions=100", "identify.samples=20"),
    "identify.search.generations=60",
)
PUBLIC = Path("hopper_transitions") / "hopper10000.npz"  # below SIM2REAL_DATA
PUBLIC_COUNT = 600  # transitions of these
BESIDE = {  # rows of the transfer study that the returns stand beside
    "ppo_source": "source alone",
    "udr width=0.075": "masses of thigh, leg and foot uniform by 7.5 %",
    "ppo_target": "target: an oracle",
}


def masses(domain: str) -> dict[str, float]:
    """Return the bodies' masses [kg] in a domain."""
    model = HopperPolito(domain, "legacy").spec().compile()  # type: ignore[arg-type]
    return {name: float(model.body(name).mass[0]) for name in BODIES}


def truth() -> np.ndarray:
    """Return the target's masses over the source's."""
    source, target = masses("source"), masses("target")
    return np.array([target[name] / source[name] for name in BODIES])


def prior(path: Path) -> Path:
    """Write what is thought possible of the four masses: factors, uniform and independent."""
    made = [Entry(make("link_mass", where=b, how="scale"), (uniform(LOW, HIGH),)) for b in BODIES]
    write(path, Distribution(tuple(made)))
    return path


def identify(log: Path, model: Path, out: Path, seed: int) -> Path | None:
    """Return the distribution.yaml of a log; None where it failed."""
    found = out / "distribution.yaml"
    if not found.is_file():
        words = ["run=identify", f"log={log}", f"model={model}", "params=distribution"]
        words += [f"params.path={prior(out.parent / 'prior.yaml')}", f"seed={seed}", *SEARCH]
        if not sim2real(*words, f"hydra.run.dir={out}"):
            return None
    return found


def train(out: Path, seed: int, frames: int, *words: str) -> bool:
    """Train PPO as the transfer study does, and evaluate it; return whether that worked."""
    if (out / "transfer.csv").is_file():
        return True
    go_on = [f"resume={out}"] if trained(out) else []
    rest = (f"frames={frames}", f"seed={seed}", f"hydra.run.dir={out}", *go_on)
    return sim2real("+experiment=ppo_source", "video=none", "keep_checkpoints=1", *rest, *words)


def run(out: Path, seed: int) -> bool:
    """Do all of a seed that is not done yet; return whether it worked."""
    hidden, model, log = (out / name for name in ("target.yaml", "source.xml", "log.csv"))
    if not train(out / "policy", seed, HALF_TRAINED):
        return False
    if not log.is_file():
        write_text(hidden, f"- {{effect: link_mass, where: torso, value: {LIGHTER}}}\n")
        write_text(model, named(HopperPolito("source", "legacy").spec()).to_xml())
        demonstrate(out / "policy", EPISODES, seed, log, str(hidden))
    found = identify(log, model, out / "identify", seed)
    words = ("params=distribution", f"params.path={found}")
    return found is not None and train(out / "trained", seed, STEPS, *words)


def public(data: Path, out: Path) -> bool:
    """Identify the public transitions; return whether that worked."""
    spec = named(HopperPolito("target", "legacy").spec())
    out.mkdir(parents=True, exist_ok=True)
    model = write_text(out / "target.xml", spec.to_xml())
    log = write_log(out / "log.csv", transitions(data / PUBLIC, spec.compile()))
    return identify(log, model, out / "identify", 0) is not None


def transitions(path: Path, model: mujoco.MjModel) -> Log:
    """Return some of the public transitions as episodes of two rows each."""
    rng = np.random.default_rng(0)
    with np.load(path) as table:
        chosen = np.sort(rng.choice(len(table["obs"]), PUBLIC_COUNT, replace=False))
        here, action, after = (table[key][chosen] for key in ("obs", "act", "next_obs"))
    both = np.stack([here, after], axis=1).reshape(2 * len(chosen), -1)
    dt = HopperPolito().frame_skip * model.opt.timestep
    names = [model.joint(i).name for i in range(model.njnt)]
    columns = {
        "episode": np.repeat(np.arange(len(chosen)), 2),
        "time": np.tile([0.0, dt], len(chosen)),
        f"qpos.{names[0]}": np.zeros(len(both)),  # how far it is does not matter
    }
    columns |= {f"qpos.{name}": both[:, i] for i, name in enumerate(names[1:])}
    columns |= {f"qvel.{name}": both[:, len(names) - 1 + i] for i, name in enumerate(names)}
    for i in range(model.nu):
        columns[f"ctrl.{model.actuator(i).name}"] = np.repeat(action[:, i], 2)
    return Log(columns)


def answer(folder: Path) -> tuple[np.ndarray, np.ndarray] | None:
    """Return mean and standard deviation (4,) of a distribution.yaml; None: there is none."""
    path = folder / "identify" / "distribution.yaml"
    if not path.is_file():
        return None
    found = read(path)
    return found.mean, found.std


def returned(folder: Path) -> float | None:
    """Return the mean return on the target of what was trained; None: it is not done."""
    path = folder / "trained" / "transfer.csv"
    if not path.is_file():
        return None
    with path.open(encoding="utf-8", newline="") as file:
        (row,) = (r for r in csv.DictReader(file) if r["tested on"].startswith("target"))
    return float(row["mean return"])


def others(seeds: Sequence[int]) -> dict[str, list[float]]:
    """Return the returns on the target of the transfer study's rows, of these seeds."""
    found: dict[str, list[float]] = {name: [] for name in BESIDE}
    with (RESULTS / "transfer" / "returns.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    wanted = {f"seed {seed}" for seed in seeds}
    for row in rows:
        name, last = row["experiment"], float(row["steps"]) >= STEPS
        if name in found and last and row["tested_on"] == "target" and row["run"] in wanted:
            found[name].append(float(row["mean_return"]))
    return found


def report(out: Path, seeds: Sequence[int], results: Path) -> str:
    """Write dropo.md and dropo.csv; return the tables."""
    rows = [
        (seed, made, returned(out / f"seed{seed}"))
        for seed in seeds
        if (made := answer(out / f"seed{seed}")) is not None
    ]
    head = ("transitions of", "seed", *BODIES, "in their 90 % intervals", "return on the target")
    found = Table(head)
    given = [(f"{NAME}'s target", s, made, truth(), value) for s, made, value in rows]
    if (made := answer(out / "public")) is not None:
        given.append(("the authors' file", 0, made, np.ones(len(BODIES)), None))
    for name, seed, (mean, std), true, value in given:
        ends = [Interval(m, m - NINETY * s, m + NINETY * s) for m, s in zip(mean, std, strict=True)]
        held = sum(one.low <= t <= one.high for one, t in zip(ends, true, strict=True))
        found.add(name, seed, *ends, f"{held} of {len(BODIES)}", value)
    lacks = ", ".join(f"{t:.3g}" for t in truth())
    found.notes.append(
        f"Factors on the masses that the model has; on the target they are {lacks}, and 1 where "
        "the model is the authors'. Brackets: 90 % of the Gaussian that was found."
    )
    earned = Table(("trained on", "runs", "return on the target (IQM)"))
    done = [value for _, _, value in rows if value is not None]
    wanted = [seed for seed, _, value in rows if value is not None]
    for name, values in {**others(wanted), NAME: done}.items():
        if values:
            words = BESIDE.get(name, "what DROPO found")
            earned.add(words, len(values), about(np.array(values)))
    earned.notes.append(
        f"`python -m benchmarks.dropo`, {STEPS:,} steps of PPO each; the other rows are those of "
        "[transfer](transfer/report.md) with the same seeds. Brackets: 95 %, bootstrap over runs."
    )
    results.mkdir(parents=True, exist_ok=True)
    both = f"{found.markdown()}\n{earned.markdown()}"
    write_text(results / f"{NAME}.md", f"# DROPO on the Hopper of the transfer studies\n\n{both}")
    write_text(results / f"{NAME}.csv", found.csv())
    return both


def about(values: np.ndarray) -> Interval | float:
    """Return the interquartile mean over runs, with its interval if there are several."""
    if len(values) < 2:
        return float(values[0])
    return bootstrap(values[:, None], iqm, np.random.default_rng(0), draws=DRAWS, resample="rows")


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the command line and run; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.dropo",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--seeds", type=int, nargs="+", default=list(range(10)), help="training seeds")
    add("--public", action="store_true", help="identify the authors' transitions too")
    add("--report", action="store_true", help="run nothing, write the tables")
    add("--out", type=Path, default=Path("outputs/bench_long") / NAME, help="folder of the runs")
    add("--results", type=Path, default=RESULTS, help="folder of the tables")
    chosen = parser.parse_args(arguments)
    out, seeds, failed = chosen.out.resolve(), list(dict.fromkeys(chosen.seeds)), 0
    data = Path(os.environ.get("SIM2REAL_DATA", "."))
    if chosen.public and not (data / PUBLIC).is_file():
        print(f"skipped: no {PUBLIC} below SIM2REAL_DATA (docs/identify.md)")
    elif chosen.public and not chosen.report:
        failed += not public(data, out / "public")
    for seed in () if chosen.report else seeds:
        with claimed(out / f"seed{seed}") as mine:
            failed += mine and not run(out / f"seed{seed}", seed)
        report(out, seeds, chosen.results)
    print(report(out, seeds, chosen.results))
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
