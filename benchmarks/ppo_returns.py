"""PPO beside Stable-Baselines3's: how soon each gets there, and whether equal settings get alike.

    python -m benchmarks.ppo_returns                       # every run: about two hours on 2 cores
    python -m benchmarks.ppo_returns --only sb3 tuned --seeds 2
    python -m benchmarks.ppo_returns --report              # the tables of what there is

Time to return, on Gymnasium's Hopper-v5: Stable-Baselines3 with its defaults for 500,000 steps; the
median of its seeds' returns at the end is the mark. Then this project's preset `ppo`, until it has
passed the mark or spent three times the steps. A seed that never gets there counts as never.

Equal settings, on the 500-step Hopper of the transfer studies: Stable-Baselines3's defaults and the
preset `ppo_sb3`, 10 seeds and 300,000 steps each; the probability that one is better than the other
should not be told from a half.

A return is the mean of the last 100 episodes of training. Runs go one after another, since their
time counts; each leaves results/ppo/<kind>-<seed>.csv, and what is there is not repeated.
"""

from __future__ import annotations

import argparse
import csv
import io
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np

from benchmarks.load import ForeignLoad
from envs.mujoco import MujocoEnv
from envs.rows import Rows
from envs.simulation import Simulation
from envs.tasks import Hopper, HopperPolito
from sim2real.runs import figures as plots
from sim2real.runs.files import write_text
from sim2real.runs.statistics import probability_of_improvement
from sim2real.runs.tables import Table

RESULTS = Path(__file__).parent / "results" / "ppo"
COLUMNS = ("train/frames", "train/return", "time/seconds", "time/other_cores")
MARK_STEPS, ALIKE_STEPS = 500_000, 300_000
PATIENCE = 3  # times the steps of the mark, after which a seed counts as never
DRAWS = 5000  # resamples of an interval
Done = Callable[[int, float], bool]  # of steps and return


@dataclass(frozen=True)
class Kind:
    """A group of runs.

    Args:
        name: of the group, and of its files.
        who: "sb3", or a preset of conf/algorithm.
        task: what is simulated.
        seeds: how many, from 0 up.
        steps: environment steps after which a run ends.
    """

    name: str
    who: Literal["sb3", "ppo", "ppo_sb3"]
    task: Callable[[], Hopper]
    seeds: int
    steps: int

    def file(self, seed: int) -> Path:
        """Return where a run's curve is."""
        return RESULTS / f"{self.name}-{seed}.csv"

    def files(self) -> list[Path]:
        """Return the curves that there are."""
        return [self.file(seed) for seed in range(self.seeds) if self.file(seed).is_file()]


KINDS = (
    Kind("sb3", "sb3", Hopper, 5, MARK_STEPS),
    Kind("tuned", "ppo", Hopper, 5, PATIENCE * MARK_STEPS),
    Kind("sb3_polito", "sb3", HopperPolito, 10, ALIKE_STEPS),
    Kind("preset_polito", "ppo_sb3", HopperPolito, 10, ALIKE_STEPS),
)


class GymRows(gymnasium.Env):
    """One row as a Gymnasium environment, for learners that want that.

    Args:
        rows: a world of one row; parameters stay neutral.
        seed: of the episodes.
    """

    def __init__(self, rows: Rows, seed: int) -> None:
        self._rows, self._luck = rows, np.random.default_rng(seed)
        wide = np.full(rows.observation_size, np.inf)
        self.observation_space = gymnasium.spaces.Box(-wide, wide, dtype=np.float64)
        low, high = rows.action_low.astype(np.float32), rows.action_high.astype(np.float32)
        self.action_space = gymnasium.spaces.Box(low, high, dtype=np.float32)

    def reset(self, **_: Any) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode."""
        seed = self._luck.integers(0, 2**63, 1).astype(np.uint64)
        return self._rows.reset(np.zeros(1, np.int64), self._rows.space.points(1), seed)[0], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance by one control step."""
        step = self._rows.step(None, action[None].astype(np.float64))
        over = bool(step.terminated[0])
        cut = bool(step.truncated[0]) and not over
        return step.observation[0].copy(), float(step.reward[0]), over, cut, {}


class Curve:
    """Steps, returns and seconds of a run, as they come."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, ...]] = []
        self._begin, self._load = time.perf_counter(), ForeignLoad()

    def note(self, steps: int, score: float) -> None:
        """Add a point."""
        seconds = time.perf_counter() - self._begin
        cores = self._load.cores()
        self.rows.append((steps, score, seconds, float("nan") if cores is None else cores))

    def write(self, path: Path) -> None:
        """Write all points at once."""
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([COLUMNS, *self.rows])
        write_text(path, text.getvalue())


def train_ours(kind: Kind, seed: int, done: Done) -> Curve:
    """Train a preset of this project."""
    from sim2real.config.compose import compose, prepare
    from sim2real.learning.algorithms.base import build

    _, given = prepare(compose([f"algorithm={kind.who}", f"seed={seed}"]), Path())
    base = partial(MujocoEnv, task=kind.task())
    environment = replace(given["parts"].environment, base=base)
    learner = build(given["algorithm"], replace(given["parts"], environment=environment))
    curve, score = Curve(), float("nan")
    while not done(learner.frames, score):
        score = learner.iterate()["train/return"]
        curve.note(learner.frames, score)
    return curve


def train_theirs(kind: Kind, seed: int) -> Curve:
    """Train Stable-Baselines3's PPO with its defaults."""
    import stable_baselines3
    from stable_baselines3.common.callbacks import BaseCallback

    class Note(BaseCallback):
        """Adds a point after each 2048 steps."""

        def _on_rollout_end(self) -> None:
            infos = self.model.ep_info_buffer or ()
            score = float(np.mean([info["r"] for info in infos])) if infos else float("nan")
            curve.note(self.num_timesteps, score)

        def _on_step(self) -> bool:
            return True

    task = kind.task()
    env = "Hopper-v5" if type(task) is Hopper else GymRows(Simulation(task, 1, threads=1), seed)
    learner = stable_baselines3.PPO("MlpPolicy", env, device="cpu", seed=seed)
    curve = Curve()
    learner.learn(kind.steps, callback=Note())
    return curve


def run(kind: Kind, seed: int) -> None:
    """Do a run, unless its file is there."""
    if kind.file(seed).is_file():
        return
    print(f"{kind.name} seed {seed}", flush=True)
    if kind.who == "sb3":
        curve = train_theirs(kind, seed)
    else:
        goal = mark() if kind.name == "tuned" else float("inf")
        curve = train_ours(kind, seed, lambda steps, score: steps >= kind.steps or score >= goal)
    curve.write(kind.file(seed))


def read(path: Path) -> np.ndarray:
    """Read a curve, (4, n): steps, returns, seconds, cores of other programs."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))[1:]
    return np.array(rows, np.float64).reshape(-1, len(COLUMNS)).T


def mark() -> float:
    """Return the median return of Stable-Baselines3's seeds at the end of their runs."""
    ends = [read(path)[1, -1] for path in KINDS[0].files()]
    if not ends:
        raise SystemExit("the mark is not known yet: run --only sb3 first")
    return float(np.median(ends))


def time_to(curve: np.ndarray, goal: float) -> float:
    """Return the seconds after which a curve (4, n) first was at a return, or infinity."""
    there = np.flatnonzero(curve[1] >= goal)
    return float(curve[2, there[0]]) if len(there) else float("inf")


def report() -> None:
    """Write the tables and the curves of what there is."""
    table = Table(("runs", "seeds", "median s to the mark", "seconds of each seed", "never"))
    tables = [_times(table)] if KINDS[0].files() and KINDS[1].files() else []
    if KINDS[2].files() and KINDS[3].files():
        tables.append(_alike())
    for name, made in tables:
        made.write(RESULTS / name)
        print(made.markdown())
    curves = {kind.name: kind.files() for kind in KINDS if kind.files()}
    for name, chosen in {"hopper": KINDS[:2], "polito": KINDS[2:]}.items():
        shown = {k.name: curves[k.name] for k in chosen if k.name in curves}
        if shown:
            plots.learning_curve(shown, RESULTS / f"{name}.png")


def _times(table: Table) -> tuple[str, Table]:
    goal, medians = mark(), []
    for kind in KINDS[:2]:
        seconds = [time_to(read(path), goal) for path in kind.files()]
        medians.append(float(np.median(seconds)))
        words = ", ".join("never" if np.isinf(s) else f"{s:.0f}" for s in seconds)
        shown = None if np.isinf(medians[-1]) else medians[-1]
        table.add(kind.name, len(seconds), shown, words, int(np.isinf(seconds).sum()))
    table.notes.append(
        f"The mark is a return of {goal:.0f}, the median of Stable-Baselines3's seeds after "
        f"{MARK_STEPS:,} steps. Ratio of the medians: {medians[0] / medians[1]:.1f}."
    )
    return "time_to_return", table


def _alike() -> tuple[str, Table]:
    ends = [
        np.array([[read(path)[1, -1]] for path in kind.files()]) for kind in (KINDS[3], KINDS[2])
    ]
    table = Table(("runs", "seeds", "mean return", "sd"))
    for kind, values in zip((KINDS[3], KINDS[2]), ends, strict=True):
        spread = float(values.std(ddof=1)) if len(values) > 1 else None
        table.add(kind.name, len(values), float(values.mean()), spread)
    if min(len(values) for values in ends) > 1:
        found = probability_of_improvement(ends[0], ends[1], np.random.default_rng(0), draws=DRAWS)
        verdict = "does not contain" if found.excludes(0.5) else "contains"
        table.notes.append(
            f"P(preset above Stable-Baselines3) = {found.value:.2f}, 95 % interval "
            f"[{found.low:.2f}, {found.high:.2f}], which {verdict} 0.5."
        )
    return "alike", table


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is missing, then report."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.ppo_returns", description="PPO beside Stable-Baselines3's."
    )
    names = [kind.name for kind in KINDS]
    parser.add_argument("--only", nargs="+", choices=names, default=names, help="groups of runs")
    parser.add_argument("--seeds", type=int, default=10, help="at most so many of each group")
    parser.add_argument("--report", action="store_true", help="run nothing")
    chosen = parser.parse_args(arguments)
    if not chosen.report:
        import torch

        torch.set_num_threads(1)
        for kind in KINDS:
            for seed in range(min(kind.seeds, chosen.seeds) if kind.name in chosen.only else 0):
                run(kind, seed)
    report()


if __name__ == "__main__":
    main()
