"""Trainings for the seeds' tables that no other study makes, resumable, and their figures.

    run("nav2d_pg", seeds=[0, 1], plan)       # trains, evaluates, adds to results/seeds.csv

Each run has a folder of its own: what is complete is skipped, what was interrupted goes on. Several
of these programs may run at once and share the work.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import read_csv, write_csv
from benchmarks.robots import cpu_minutes, timed
from benchmarks.study import sim2real, trained
from sim2real.evaluation.scores import GridScores
from sim2real.evaluation.transfer import read as read_transfer
from sim2real.runs.files import folder_lock

COLUMNS = ("training", "seed", "figure", "value", "steps", "cpu_minutes", "command", "versions")
THEN = "then"  # folder of an evaluation within its run's
PACKAGES = ("sim2real", "torch", "torchrl", "mujoco", "numpy")  # that a figure may depend on


@dataclass(frozen=True)
class Plan:
    """What can be trained, and where."""

    # by name, overrides of the command line (`do`), or another training whose policies are
    # evaluated (`of`); overrides of an evaluation of the trained policy (`then`), whose figures
    # count instead of the training's own
    trainings: Mapping[str, Mapping[str, Any]]
    out: Path  # folder of the runs
    table: Path  # the CSV file of the figures

    def source(self, name: str) -> str:
        """Return the training that trains the policy."""
        return self.trainings[name].get("of", name)

    def words(self, name: str) -> Sequence[str]:
        """Return the overrides that train the policy."""
        return self.trainings[self.source(name)]["do"]

    def trained(self, name: str, seed: int) -> Path:
        """Return the folder of the run that trains the policy."""
        return self.folder(self.source(name), seed)

    def folder(self, name: str, seed: int) -> Path:
        """Return a run's folder."""
        return self.out / name / f"seed{seed}"


def run(name: str, seeds: Sequence[int], plan: Plan) -> int:
    """Train and evaluate what is not yet done; return how many runs failed."""
    failed, then = 0, plan.trainings[name].get("then")
    for seed in seeds:
        folder, policy = plan.folder(name, seed), plan.trained(name, seed)
        with ExitStack() as stack:
            mine = [
                stack.enter_context(folder_lock(one)) for one in dict.fromkeys((folder, policy))
            ]
            if not all(mine) or list(figures(folder, then)):
                continue
            with timed(folder):
                done = train(policy, seed, plan.words(name))
                if done and then:
                    done = evaluate(policy, seed, then, folder)
            failed += not done
        collect(plan)
    return failed


def train(folder: Path, seed: int, words: Sequence[str]) -> bool:
    """Train a policy that is not there yet; return whether that came to its end."""
    if list(figures(folder)):
        return True
    go_on = [f"resume={folder}"] if trained(folder) else []
    rest = (f"seed={seed}", "video=none", "keep_checkpoints=1", f"hydra.run.dir={folder}")
    return sim2real(*words, *rest, *go_on)


def evaluate(policy: Path, seed: int, words: Sequence[str], folder: Path) -> bool:
    """Evaluate a trained policy once more, in a folder; return whether it came to its end."""
    given = ("run=evaluate", f"checkpoint={policy}", f"seed={seed}")
    return sim2real(*given, *words, f"hydra.run.dir={folder / THEN}")


def figures(folder: Path, then: object = None) -> Iterator[tuple[str, float, int]]:
    """Yield name, value and training steps of each figure of a complete run."""
    folder = folder / THEN if then else folder
    if (folder / "evaluation.json").is_file():
        scores = GridScores.read(folder)
        for name, values in (("before", scores.before), ("after", scores.after)):
            yield name, float(np.mean(values)), scores.frames[0]
    for file in sorted(folder.glob("transfer-*.json"))[-1:]:
        (one,) = read_transfer(file)
        for robot, returns in one.returns.items():
            yield robot, float(returns.mean()), one.frames


def collect(plan: Plan) -> None:
    """Put the figures of all complete runs into the table; those of other machines stay."""
    rows = {_key(row): row for row in read_csv(plan.table)}
    for name, about in plan.trainings.items():
        for folder in sorted((plan.out / name).glob("seed*")):
            seed = folder.name.removeprefix("seed")
            own = {
                "training": name,
                "seed": seed,
                "cpu_minutes": f"{spent:.1f}" if (spent := cpu_minutes(folder)) else "",
                "command": " ".join(["sim2real", *plan.words(name), f"seed={seed}"]),
                "versions": _versions(plan.trained(name, int(seed))),
            }
            for figure, value, steps in figures(folder, about.get("then")):
                row = {**own, "figure": figure, "value": f"{value:.6g}", "steps": str(steps)}
                rows[_key(row)] = row
    if rows:
        write_csv(plan.table, ({c: row[c] for c in COLUMNS} for _, row in sorted(rows.items())))


def _key(row: Mapping[str, str]) -> tuple[str, int, str]:
    return row["training"], int(row["seed"]), row["figure"]


def _versions(folder: Path) -> str:
    """Return the packages that made a run, of its manifest, and the project's revision."""
    manifest: dict[str, Any] = json.loads((folder / "manifest.json").read_text("utf-8"))
    found = [f"{p} {manifest['packages'][p]}" for p in PACKAGES if p in manifest["packages"]]
    return " ".join([*found, f"revision {(manifest['git'] or {}).get('revision', '–')[:7]}"])
