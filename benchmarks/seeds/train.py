"""Trainings for the seeds' tables that no other study makes, resumable, and their figures.

    run("nav2d_pg", seeds=[0, 1], plan)       # trains, evaluates, adds to results/seeds.csv

Each run has a folder of its own: what is complete is skipped, what was interrupted goes on. Several
of these programs may run at once and share the work.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.cases import read_csv
from benchmarks.robots import cpu_minutes, timed
from benchmarks.study import sim2real, trained
from sim2real.evaluation.scores import GridScores
from sim2real.evaluation.transfer import read as read_transfer
from sim2real.runs.files import folder_lock, write_text

COLUMNS = ("training", "seed", "figure", "value", "steps", "cpu_minutes", "command", "versions")
THEN = "then"  # folder of an evaluation within its run's
PACKAGES = ("sim2real", "torch", "torchrl", "mujoco", "numpy")  # that a figure may depend on


@dataclass(frozen=True)
class Plan:
    """What can be trained, and where.

    Args:
        trainings: overrides of the command line, by name.
        then: overrides of an evaluation of the trained policy, by name, whose figures count
            instead of the training's own.
        of: another training whose policies are evaluated, by name.
        out: folder of the runs.
        table: the CSV file of the figures.
    """

    trainings: Mapping[str, Sequence[str]]
    out: Path
    table: Path
    then: Mapping[str, Sequence[str]] = field(default_factory=dict)
    of: Mapping[str, str] = field(default_factory=dict)

    def trained(self, name: str, seed: int) -> Path:
        """Return the folder of the run that trains the policy."""
        return self.folder(self.of.get(name, name), seed)

    def folder(self, name: str, seed: int) -> Path:
        """Return a run's folder."""
        return self.out / name / f"seed{seed}"


def run(name: str, seeds: Sequence[int], plan: Plan) -> int:
    """Train and evaluate what is not yet done; return how many runs failed."""
    failed = 0
    for seed in seeds:
        folder, policy = plan.folder(name, seed), plan.trained(name, seed)
        with ExitStack() as stack:
            mine = [
                stack.enter_context(folder_lock(one)) for one in dict.fromkeys((folder, policy))
            ]
            if not all(mine) or list(figures(folder, name in plan.then)):
                continue
            with timed(folder):
                done = train(policy, seed, plan.trainings[name])
                if done and name in plan.then:
                    done = evaluate(policy, seed, plan.then[name], folder)
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


def figures(folder: Path, then: bool = False) -> Iterator[tuple[str, float, int]]:
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
    for name, overrides in plan.trainings.items():
        for folder in sorted((plan.out / name).glob("seed*")):
            seed = folder.name.removeprefix("seed")
            about = {
                "training": name,
                "seed": seed,
                "cpu_minutes": f"{spent:.1f}" if (spent := cpu_minutes(folder)) else "",
                "command": " ".join(["sim2real", *overrides, f"seed={seed}"]),
                "versions": _versions(plan.trained(name, int(seed))),
            }
            for figure, value, steps in figures(folder, name in plan.then):
                row = {**about, "figure": figure, "value": f"{value:.6g}", "steps": str(steps)}
                rows[_key(row)] = row
    lines = [",".join(COLUMNS)]
    lines += [",".join(_field(row[c]) for c in COLUMNS) for _, row in sorted(rows.items())]
    write_text(plan.table, "\n".join(lines) + "\n")


def _key(row: Mapping[str, str]) -> tuple[str, int, str]:
    return row["training"], int(row["seed"]), row["figure"]


def _field(text: str) -> str:
    return f'"{text}"' if "," in text else text


def _versions(folder: Path) -> str:
    """Return the packages that made a run, of its manifest, and the project's revision."""
    manifest: dict[str, Any] = json.loads((folder / "manifest.json").read_text("utf-8"))
    found = [f"{p} {manifest['packages'][p]}" for p in PACKAGES if p in manifest["packages"]]
    return " ".join([*found, f"revision {(manifest['git'] or {}).get('revision', '–')[:7]}"])
