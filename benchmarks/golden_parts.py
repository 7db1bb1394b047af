"""The parts of the golden files: which jobs each runs, and which figures it keeps of their folders.

    for job in PARTS["ppo"].jobs():
        job.arguments        # of python -m sim2real; {RUNS} stands for their folder
        job.figures(folder)  # what is compared

A part's rule says what a comparison asks of it: "identical" to the last digit, "alike" (the mean
over the jobs of a figure within `golden_compare.TOLERANCE`), or "printed".
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

Figures = dict[str, Any]  # nested; leaves are numbers, text, truth values and None
Rule = Literal["identical", "alike", "printed"]
RETURNS = ("training_return", "source_return", "target_return")  # the first one scatters least


@dataclass(frozen=True)
class Job:
    """A run of the command line.

    Args:
        name: of its folder below the runs.
        arguments: of `python -m sim2real`; `{RUNS}` stands for the folder of all runs.
        figures: reads what is compared from its folder.
    """

    name: str
    arguments: tuple[str, ...]
    figures: Callable[[Path], Figures]


@dataclass(frozen=True)
class Part:
    """What belongs together in one file.

    Args:
        jobs: makes the jobs, in their order.
        rule: what a comparison asks.
        figures: whose means over the jobs a comparison tells; "alike" is about the first.
    """

    jobs: Callable[[], list[Job]]
    rule: Rule = "identical"
    figures: tuple[str, ...] = RETURNS


def sha256(data: bytes) -> str:
    """Return the hash of bytes."""
    return hashlib.sha256(data).hexdigest()


def hashed(file: Path) -> str:
    """Return the hash of a file."""
    return sha256(file.read_bytes())


def columns(file: Path) -> dict[str, list[float | str | None]]:
    """Return the columns of a CSV file; numbers as such, empty cells as None."""
    rows = list(csv.DictReader(io.StringIO(file.read_text(encoding="utf-8"))))
    return {name: [number(row[name]) for row in rows] for name in rows[0]}


def number(text: str) -> float | str | None:
    """Return a cell's number, its text, or None for an empty one."""
    try:
        return float(text) if text else None
    except ValueError:
        return text


def arrays(run: Path) -> list[str]:
    """Return shape and hash of each array that the newest checkpoint holds, sorted.

    Without those of the process's random generators, and whatever the arrays are called.
    """
    file = max((run / "checkpoints").iterdir())
    found = []
    with zipfile.ZipFile(file) as archive:
        for name in archive.namelist():
            if name.endswith(".npz") and "random" not in name:
                held = np.load(io.BytesIO(archive.read(name)), allow_pickle=False)
                found += [f"{held[k].shape} {sha256(held[k].tobytes())}" for k in held.files]
    return sorted(found)


def trained(run: Path) -> Figures:
    """Return the metrics of a training and the hashes of what it ended with."""
    return {"metrics": columns(run / "metrics.csv"), "checkpoint": arrays(run)}


def evaluated(run: Path) -> Figures:
    """Return a training's metrics and the table of its evaluation on a grid."""
    table, grid = columns(run / "table.csv"), hashed(run / "grid.csv")
    return {**trained(run), "table": table, "grid.csv": grid}


def transferred(run: Path) -> Figures:
    """Return what a training got in its last episodes, and its policy on both robots."""
    metrics, transfer = columns(run / "metrics.csv"), columns(run / "transfer.csv")
    returns = (metrics["train/return"][-1], *transfer["mean return"])
    return {
        **dict(zip(RETURNS, returns, strict=True)),
        "episode_length": metrics["train/episode_length"][-1],
        "frames": metrics["train/frames"][-1],
        "metrics.csv": hashed(run / "metrics.csv"),
    }


def deployed(run: Path) -> Figures:
    """Return the returns on the bus, and the hash of every log; the emulator's clock is its own."""
    logs = {file.name: hashed(file) for file in sorted((run / "logs").glob("*.csv"))}
    for file in sorted((run / "logs").glob("*.json")):
        said = json.loads(file.read_text(encoding="utf-8"))
        said.pop("model")  # a path from the run's folder
        logs[file.name] = sha256(json.dumps(said, sort_keys=True).encode())
    table = columns(run / "table.csv")
    return {"returns": columns(run / "returns.csv"), "table": table, "logs": logs}


def esmaml() -> list[Job]:
    """Return the main job, short, with a small evaluation of what it ended with."""
    limits = ("iterations=3", "frames=null", "algorithm.warm_up=0", "video=none", "logger=csv")
    small = ("eval.adaptations=1", "eval.episodes=1", "eval.draws=200")
    return [Job("esmaml", ("+experiment=esmaml", *limits, *small), evaluated)]


def nav2d() -> list[Job]:
    """Return a short training of the toy and its evaluation on all goals."""
    return [Job("nav2d", ("+experiment=nav2d", "iterations=30"), evaluated)]


def deploy() -> list[Job]:
    """Return a short training of the quad8, and its policy on the emulated bus."""
    short = ("+experiment=quad8_es", "iterations=3", "video=none", "eval=none")
    bus = ("run=deploy", "checkpoint={RUNS}/deploy/trained", "robot=quad8")
    return [Job("deploy/trained", short, trained), Job("deploy/bus", bus, deployed)]


def trainings(name: str, seeds: int, *arguments: str) -> Callable[[], list[Job]]:
    """Return what makes a job of each seed."""

    def jobs() -> list[Job]:
        return [
            Job(f"{name}/seed{seed}", (*arguments, f"seed={seed}"), transferred)
            for seed in range(seeds)
        ]

    return jobs


SOURCE = "+experiment=ppo_source"
PARTS = {
    "esmaml": Part(esmaml),
    "deploy": Part(deploy),
    "ppo": Part(trainings("ppo", 20, SOURCE, "algorithm=ppo", "frames=50000"), "alike"),
    "ppo_sb3": Part(trainings("ppo_sb3", 5, SOURCE, "frames=50000"), "printed"),
    "sac": Part(trainings("sac", 5, "+experiment=sac_source", "frames=10000"), "printed"),
    "nav2d": Part(nav2d),
}
