"""Which adaptation works: hill climbing, gradient or none, on tasks that take seconds.

    python -m benchmarks.toys                              # all, 5 seeds: a quarter of an hour
    python -m benchmarks.toys --only nav2d --seeds 2

Writes results/toys.csv and prints a table. Runs that the file has are not repeated; delete it to
start over.

Trains each operator with the published hyper-parameters (Song et al. 2020: sigma 0.1, adaptation
sigma 0.1, gradient step 0.05, SGD with rate 0.01, 150 antithetic pairs, 300 iterations, a linear
policy) and scores it on 500 tasks that training has not drawn. The noisy tasks spend the same
budget of 50 proposals on different rules, with 50 pairs and 60 iterations, and are scored without
noise. The "steps" rows spend the same 51 to 55 episodes on rules that change the size of their
steps, or run the incumbent again in each round.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import zip_longest
from typing import Any

import numpy as np

from benchmarks.cases import over_runs, read_csv, write_csv
from benchmarks.study import command
from envs.rows import Rows
from envs.toys import Corners, FourCorners, Nav2D, NavGoals, NoisyNav2D, ToyEnv
from sim2real.learning.adapt import Adaptation, GradientAdaptation, HillClimb, NoAdaptation
from sim2real.learning.adapt.hillclimb import Mode
from sim2real.learning.algorithms.base import Components
from sim2real.learning.algorithms.esmaml import ESMAML, ESMAMLSettings
from sim2real.learning.environment import EnvironmentFactory
from sim2real.learning.modules.mlp_policy import mlp_policy
from sim2real.learning.population.population import evaluate_adaptation
from sim2real.runs.tables import Table

TEST_TASKS = 500
POLICY = partial(mlp_policy, hidden=(), activation="tanh", output="linear", initial="zero")
TRAINING: dict[str, Any] = {
    "shards": 1,
    "sigma": 0.1,
    "learning_rate": 0.01,
    "optimizer": "sgd",
    "estimator": "antithetic",
    "shaping": "standardized",
    "top_k": 0,
    "orthogonal": False,
    "weight_decay": 0.0,
    "paired_tasks": True,
    "tasks_per_member": 1,
    "final_episodes": 1,
    "step_cost": 0.0,
    "normalize_observations": False,
    "meta_estimator": "zeroth_order",
    "first_order_queries": 1,
}


@dataclass(frozen=True)
class Experiment:
    """Operators compared on one task."""

    env: Callable[..., Rows]  # makes the environment
    tasks: Callable[[], Any]  # makes its tasks
    # name to adaptation; the order is that of the claim, best first
    operators: Mapping[str, Adaptation]
    pairs: int = 150  # perturbation directions an iteration
    iterations: int = 300  # training length
    clean: tuple[str, ...] = ()  # parameters that are neutral when scored


def published(queries: int) -> dict[str, Adaptation]:
    """Return the operators of the paper at K queries."""
    return {
        "hill climbing": HillClimb(mode="sequential", queries=queries, parallel=1, sigma=0.1),
        "gradient": GradientAdaptation(queries=queries, sigma=0.1, rate=0.05, baseline="mean"),
        "none": NoAdaptation(),
    }


def noisy(**noise: Any) -> Experiment:
    """Return the rules of hill climbing compared at 50 proposals under a noisy return."""
    rules = {
        "batch": HillClimb(mode="batch", queries=10, parallel=5, sigma=0.1),
        "sequential": HillClimb(mode="sequential", queries=50, parallel=1, sigma=0.1),
        "average": HillClimb(mode="average", queries=10, parallel=5, sigma=0.1),
    }
    env = partial(NoisyNav2D, **noise)
    return Experiment(env, partial(NavGoals, 1.0), rules, 50, 60, ("return_noise",))


def climb(mode: Mode, queries: int, parallel: int, **more: Any) -> HillClimb:
    """Return a rule that begins with one episode of the policy as it is."""
    own: dict[str, Any] = {"incumbent_episodes": 1, "sigma": 0.1}
    return HillClimb(mode=mode, queries=queries, parallel=parallel, **(own | more))


def steps(**noise: Any) -> Experiment:
    """Return rules that change their steps, or run the incumbent again, under a noisy return."""
    rules = {
        "batch, again": climb("batch", 9, 5, reevaluate_incumbent=True),
        "batch": climb("batch", 10, 5),
        "sequential, again": climb("sequential", 26, 1, reevaluate_incumbent=True),
        "annealed": climb("sequential", 50, 1, sigma=0.2, grow=0.96, shrink=0.96),
        "one fifth": climb("sequential", 50, 1, grow=1.5, shrink=1.5**-0.25),
        "sequential": climb("sequential", 50, 1),
    }
    env = partial(NoisyNav2D, **noise)
    return Experiment(env, partial(NavGoals, 1.0), rules, 50, 60, ("return_noise",))


EXPERIMENTS = {
    "nav2d, K = 20": Experiment(Nav2D, NavGoals, published(20)),
    "corners, K = 5": Experiment(FourCorners, Corners, published(5)),
    "corners, K = 20": Experiment(FourCorners, Corners, published(20)),
    "nav2d, 30 % corrupted": noisy(noise="corrupt", scale=100.0, share=0.3),
    "nav2d, Gaussian sd 20": noisy(noise="gaussian", scale=20.0),
    "steps, 30 % corrupted": steps(noise="corrupt", scale=100.0, share=0.3),
    "steps, Gaussian sd 20": steps(noise="gaussian", scale=20.0),
}


def run(name: str, operator: str, seed: int) -> dict[str, Any]:
    """Train one operator once and score it; return a row of the results."""
    experiment = EXPERIMENTS[name]
    world = EnvironmentFactory(partial(ToyEnv, experiment.env), experiment.tasks())
    algorithm = ESMAML(
        Components(world, POLICY, seed, experiment.operators[operator]),
        ESMAMLSettings(
            pairs=experiment.pairs,
            num_rows=2 * experiment.pairs,
            refill=2 * experiment.pairs // 3,
            clean_final=experiment.clean,
            **TRAINING,
        ),
    )
    start = time.thread_time()
    for _ in range(experiment.iterations):
        algorithm.iterate()
    seconds = time.thread_time() - start
    before, after = score(algorithm, experiment)
    return {
        "experiment": name,
        "operator": operator,
        "seed": seed,
        "iterations": experiment.iterations,
        "frames": algorithm.frames,
        "cpu_seconds": round(seconds, 1),
        "before": round(before, 3),
        "after": round(after, 3),
    }


def score(algorithm: ESMAML, experiment: Experiment) -> tuple[float, float]:
    """Return the mean return before and after adaptation, on the same test tasks for all."""
    rng = np.random.default_rng(20_000)
    values = algorithm.tasks.sample(rng, TEST_TASKS)
    final = values.copy()
    final[:, [algorithm.population.space.index(n) for n in experiment.clean]] = 0.0
    scores = evaluate_adaptation(
        algorithm.population,
        algorithm.theta,
        algorithm.normalizer,
        algorithm.adapt,
        values,
        rng.integers(0, 2**63, TEST_TASKS, dtype=np.uint64),
        1,
        final,
    )
    return float(scores.before.mean()), float(scores.after.mean())


def table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return means over seeds with bootstrap intervals, and the gaps to the next operator."""
    made = Table(("task", "adaptation", "before", "after", "gain", "above the next", "CPU s"))
    for name, experiment in EXPERIMENTS.items():
        columns: dict[str, np.ndarray] = {}  # before, after and seconds of each seed, (3, seeds)
        for operator in experiment.operators:
            own = [r for r in rows if (r["experiment"], r["operator"]) == (name, operator)]
            own = sorted(own, key=lambda row: int(row["seed"]))
            keys = ("before", "after", "cpu_seconds")
            if len(own) > 1:
                columns[operator] = np.array([[float(row[key]) for row in own] for key in keys])
        following = [*columns.values()][1:]
        for (operator, own), rest in zip_longest(columns.items(), following):
            before, after, seconds = own
            gap = None
            if rest is not None and rest.shape == own.shape:
                gap = over_runs(after - rest[1])
            scores = (over_runs(before), over_runs(after), over_runs(after - before))
            made.add(name, operator, *scores, gap, float(seconds.mean()))
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is asked for, write the CSV and print the table."""
    parser = command("toys", __doc__, "results")
    parser.add_argument("--seeds", type=int, default=5, help="training seeds, 0 … n - 1")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--only", default="", help="experiments whose name contains this")
    chosen = parser.parse_args(arguments)
    path = chosen.results / "toys.csv"
    rows: list[dict[str, Any]] = [*read_csv(path)]
    done = {(row["experiment"], row["operator"], int(row["seed"])) for row in rows}
    work = [
        (name, operator, seed)
        for seed in range(chosen.seeds)
        for name, experiment in EXPERIMENTS.items()
        if chosen.only in name
        for operator in experiment.operators
        if (name, operator, seed) not in done
    ]
    with ProcessPoolExecutor(chosen.jobs) as pool:
        for row in pool.map(run, *zip(*work, strict=True)) if work else ():
            rows.append(row)
            write_csv(path, rows)
    print(table(rows).markdown())
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
