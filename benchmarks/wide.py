"""What many cores and a GPU give: rows for a machine that has them, with the machine's name.

    python -m benchmarks.wide                 # every row that this machine can measure
    python -m benchmarks.wide es hopper       # some of them

Rates are environment steps a second; both sides of a ratio run in this process, one after the
other. Each row goes into results/wide.csv with command, versions, processor and card; rows that
were measured before stay, those measured again are replaced.
"""

import platform
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import psutil
import torch

from benchmarks.cases import read_csv, write_csv
from benchmarks.rows.population import Evaluation
from benchmarks.study import RESULTS
from benchmarks.world import Gait, make_tasks
from envs.mujoco import MujocoEnv
from envs.tasks import Hopper
from envs.tasks.base import Task
from envs.tasks.servo.quad8 import Quad8
from sim2real.learning.algorithms.shards import layout, make_shards
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.population.population import Population
from sim2real.runs.files import write_text

WIDE, SHARDS, RETURNS = (RESULTS / f"{name}.csv" for name in ("wide", "shards", "ppo_wide"))
SPLITS = (1, 2, 4, 8, 16)  # shards, with the cores' threads between them
SECONDS, STEPS = 12.0, 30  # of a training's rate, and of the bare graph's
HIDDEN = 64  # of both layers of the acting policy
JOBS: tuple[tuple[Gait, int, int], ...] = (  # policy, members, rows
    ("hopping", 512, 1024),
    ("hopping", 256, 256),
    ("fresh", 2048, 256),
)
Row = tuple[str, float, float, str]  # name, value, reference, unit


def cores() -> int:
    """Return how many this process may use."""
    return len(psutil.Process().cpu_affinity()) if psutil.LINUX else psutil.cpu_count() or 1


def population_rate(job: Evaluation, rows: int, count: int) -> float:
    """Return the steps a second of whole episodes in a number of shards over the cores."""
    world: Any = partial(MujocoEnv, task=Hopper())
    made = make_shards(EnvironmentFactory(world, make_tasks()), rows, count)
    population = Population(made, job.controller.policy, 8)
    begun = time.perf_counter()
    frames = population.run(job.members(), job.controller.normalizer()).frames
    return frames / (time.perf_counter() - begun)


def es() -> Iterator[Row]:
    """Yield whole episodes of 512 members in the layout that is chosen and in the best one."""
    job, rows, there = Evaluation(512, 1, "hopping"), 256, cores()
    population_rate(job, rows, 1)  # warm
    rates = {split: population_rate(job, rows, split) for split in SPLITS if split <= there}
    best = max(rates.values())
    yield "es_population / best split", rates[layout(rows, there)[0]], best, "steps/s"
    yield "es_population, best split / a shard a core", best, rates[max(rates)], "steps/s"


def shards() -> Iterator[Row]:
    """Write the rates of all splits of three jobs over the cores of this process."""
    lines = ["cores,policy,members,rows,shards,threads,steps_per_s"]
    for gait, members, rows in JOBS:
        job = Evaluation(members, 1, gait)
        for count in (split for split in SPLITS if split <= cores()):
            rate = round(population_rate(job, rows, count))
            lines.append(f"{cores()},{gait},{members},{rows},{count},{cores() // count},{rate}")
    write_text(SHARDS, "\n".join(lines) + "\n")
    yield from ()


RUNS = (  # environment, preset, frames, seeds
    ("hopper", "ppo", 500_000, 3),
    ("hopper", "ppo_wide", 1_500_000, 5),
    ("quad8", "ppo", 200_000, 3),
    ("quad8", "ppo_wide", 600_000, 3),
)


def returns() -> Iterator[Row]:
    """Write what the presets reach: means of the last episodes of training."""
    lines = ["env,algorithm,seed,frames,return"]
    for env, preset, frames, seeds in RUNS:
        for seed in range(seeds):
            learner, found = learner_of(f"env={env}", f"algorithm={preset}", f"seed={seed}"), {}
            while learner.frames < frames:
                found = learner.iterate()
            lines.append(f"{env},{preset},{seed},{learner.frames},{found['train/return']:.4g}")
            write_text(RETURNS, "\n".join(lines) + "\n")
    yield from ()


def learner_of(*overrides: str, base: Any = None) -> Any:
    """Return the algorithm of a configuration, on a world of its own where one is given."""
    from sim2real.config.compose import compose, instantiate
    from sim2real.learning.algorithms.base import build

    _, given = instantiate(compose(list(overrides)), Path())
    parts = given["parts"]
    if base is not None:
        parts = replace(parts, environment=replace(parts.environment, base=base))
    return build(given["algorithm"], parts)


def ppo_rate(preset: str, task: Task, device: str, physics: str) -> float:
    """Return the steps a second of a preset's iterations, the first two left out."""
    base = partial(MujocoEnv, task=task, physics=physics)
    learner = learner_of(f"algorithm={preset}", f"device={device}", base=base)
    for _ in range(2):
        learner.iterate()
    first, begun = learner.frames, time.perf_counter()
    while time.perf_counter() - begun < SECONDS:
        learner.iterate()
    return (learner.frames - first) / (time.perf_counter() - begun)


def ppo() -> Iterator[Row]:
    """Yield training's rate with the presets on the cores."""
    small = ppo_rate("ppo", Hopper(), "cpu", "batch")
    wide = ppo_rate("ppo_wide", Hopper(), "cpu", "batch")
    yield "ppo_wide / ppo", wide, small, "steps/s"
    if torch.cuda.is_available():
        card = ppo_rate("ppo_wide", Hopper(), "cuda", "warp")
        yield "ppo_wide on Warp / on the cores", card, wide, "steps/s"


def acting_rate(env: MujocoEnv, steps: int) -> float:
    """Return the steps a second of an environment under a perceptron, restarts included."""
    torch.manual_seed(0)
    size, actions = env.observation_spec["observation"].shape[-1], env.action_spec.shape[-1]
    net = torch.nn.Sequential(
        torch.nn.Linear(size, HIDDEN),
        torch.nn.Tanh(),
        torch.nn.Linear(HIDDEN, HIDDEN),
        torch.nn.Tanh(),
        torch.nn.Linear(HIDDEN, actions),
    ).to(env.device)
    now = env.reset()

    def go(count: int) -> None:
        nonlocal now
        with torch.no_grad():
            for _ in range(count):
                now["action"] = net(now["observation"])
                now = env.maybe_reset(env._step(now))

    go(30)
    return timed(lambda: go(steps)) * steps * env.batch_size[0]


def timed(work: Callable[[], None]) -> float:
    """Return how often a second some work is done."""
    if torch.cuda.is_available():
        torch.cuda.synchronize()
    begun = time.perf_counter()
    work()
    if torch.cuda.is_available():
        torch.cuda.synchronize()
    return 1.0 / (time.perf_counter() - begun)


def raw_rate(env: MujocoEnv) -> float:
    """Return the steps a second of the engine's graph alone."""
    plant, skip = env.simulation.plant, env.simulation.task.frame_skip
    plant.physics.step(None, skip)

    def go() -> None:
        for _ in range(STEPS):
            plant.physics.step(None, skip)

    return timed(go) * STEPS * env.batch_size[0]


def hopper() -> Iterator[Row]:
    """Yield Hopper on Warp, masses and frictions drawn at each reset, beside the bare graph."""
    tasks = make_tasks()
    for count in (4096, 16384):
        env = MujocoEnv(Hopper(), count, tasks.effects, device="cuda", physics="warp", tasks=tasks)
        raw = raw_rate(env)
        yield f"Hopper on Warp, {count} / raw graph", acting_rate(env, 100), raw, "steps/s"


def quad8() -> Iterator[Row]:
    """Yield quad8 of servo fidelity on Warp beside all cores."""
    card = acting_rate(MujocoEnv(Quad8(), 4096, device="cuda", physics="warp"), 100)
    host = acting_rate(MujocoEnv(Quad8(), 4096), 20)
    yield "quad8 on Warp, 4096 / the cores", card, host, "steps/s"


def queue() -> Iterator[Row]:
    """Yield the part of the worlds in use in a generation of 16,384 episodes, and its rate."""
    job = Evaluation(16384, 1, "hopping")
    world: Any = partial(MujocoEnv, task=Hopper(), physics="warp")
    rows = EnvironmentFactory(world, make_tasks()).rows(4096, 0, "cuda")
    population = Population([rows], job.controller.policy, 64)
    begun = time.perf_counter()
    found = population.run(job.members(), job.controller.normalizer())
    rate = found.frames / (time.perf_counter() - begun)
    yield "ES generation of 16384 episodes, 4096 worlds: in use", population.in_use, 1.0, ""
    yield "ES generation of 16384 episodes, 4096 worlds: rate", rate, float("nan"), "steps/s"


PARTS: dict[str, tuple[bool, Callable[[], Iterator[Row]]]] = {  # whether it takes a card
    "shards": (False, shards),
    "returns": (False, returns),
    "es": (False, es),
    "ppo": (False, ppo),
    "hopper": (True, hopper),
    "quad8": (True, quad8),
    "queue": (True, queue),
}


def record(found: Row, part: str) -> None:
    """Put a row into the file, in place of its former one."""
    name, value, reference, unit = found
    card = torch.cuda.get_device_name() if torch.cuda.is_available() else ""
    libraries = ("torch", "torchrl", "numpy") + (("mujoco-warp", "warp-lang") if card else ())
    versions = " ".join(f"{library}={version(library)}" for library in libraries)
    line = {
        "row": name,
        "value": f"{value:.6g}",
        "reference": f"{reference:.6g}",
        "ratio": f"{value / reference:.3g}",
        "unit": unit,
        "cores": f"{cores()} {platform.machine()}",
        "card": card,
        "versions": f"mujoco={mujoco.__version__} {versions}",
        "command": f"python -m benchmarks.wide {part}",
    }
    rows = {(row["row"], row["card"]): row for row in read_csv(WIDE)} | {(name, card): line}
    write_csv(WIDE, rows.values())
    print(f"{name}: {value:.5g} / {reference:.5g} = {value / reference:.3g}", flush=True)


def main(chosen: list[str]) -> None:
    """Measure the parts that are asked for, or all that this machine can."""
    unknown = set(chosen) - PARTS.keys()
    if unknown:
        raise SystemExit(f"no such rows: {', '.join(unknown)}; there are: {', '.join(PARTS)}")
    for name, (needs_card, rows) in PARTS.items():
        if name in chosen or (not chosen and (torch.cuda.is_available() or not needs_card)):
            for row in rows():
                record(row, name)


if __name__ == "__main__":
    np.seterr(all="ignore")
    main(sys.argv[1:])
