"""Folders of evaluated runs, made without training."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from sim2real.evaluation.transfer import TransferScores, write

ROBOTS: dict[str, dict[str, Any]] = {"source": {"domain": "source"}, "target": {"domain": "target"}}


def make_run(
    root: Path,
    experiment: str,
    seed: int,
    means: tuple[float, float],
    *,
    steps: int = 500_000,
    params: dict[str, Any] | None = None,
    algorithm: dict[str, Any] | None = None,
    expect: dict[str, Any] | None = None,
    curve: Sequence[tuple[int, float]] = ((1000, 10.0), (2000, 20.0)),
    trained_on: str = "source",
    masses: str = "native",
    task: str = "HopperPolito",
) -> Path:
    """Leave what one run leaves: two episodes on each robot, 1 below and 1 above its mean."""
    name = "-".join([experiment, *(f"{v}" for v in (params or {}).values())])
    folder = root / name / f"seed{seed}"
    (folder / ".hydra").mkdir(parents=True, exist_ok=True)
    env = {"task": {"domain": trained_on, "masses": masses, "max_steps": 500}}
    tree = {"env": env, "params": params or {}, "algorithm": algorithm or {}, "expect": expect}
    (folder / "config.yaml").write_text(yaml.safe_dump(tree), encoding="utf-8")
    (folder / ".hydra" / "overrides.yaml").write_text(f"[+experiment={experiment}, seed={seed}]")
    names = "train/frames,train/return" + (",train/kl" if algorithm else "")
    rows = [f"{x},{y}" + (f",{y / 1000}" if algorithm else "") for x, y in curve]
    (folder / "metrics.csv").write_text("\n".join([names, *rows, ""]), encoding="utf-8")
    returns = {r: np.array([m - 1, m + 1]) for r, m in zip(ROBOTS, means, strict=True)}
    lengths = {robot: np.array([10, 10]) for robot in ROBOTS}
    scores = TransferScores(
        f"seed {seed}", task, trained_on, steps, ROBOTS, returns, lengths, dict.fromkeys(ROBOTS, 0)
    )
    write([scores], 0, folder)
    return folder
