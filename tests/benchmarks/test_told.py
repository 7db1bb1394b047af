"""Policies that are told their robot: what the table makes of deployments."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from benchmarks.told import TRAINING, WAYS, main
from sim2real.config.compose import compose


def deployment(folder: Path, before: float, after: float, spent: int) -> None:
    """Leave what a deployment leaves."""
    folder.mkdir(parents=True)
    rows = [("as trained", before), *[("adapting", 0.0)] * spent, ("adapted", after)]
    lines = [f"{phase},{number},{value}" for number, (phase, value) in enumerate(rows)]
    (folder / "returns.csv").write_text("phase,episode,return\n" + "\n".join(lines) + "\n")
    (folder / "table.csv").write_text("")


def test_gains_are_paired_over_seeds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two seeds whose returns differ much and gain alike: an interval of the gain without width."""
    for seed, before in ((0, 0.2), (1, 0.8)):
        deployment(tmp_path / f"seed{seed}" / "identify_load", before, before + 0.3, 3)
    deployment(tmp_path / "seed0" / "climb_load", 0.2, 0.4, 50)
    arguments = ["--report", "--out", str(tmp_path), "--results", str(tmp_path / "results")]
    assert main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    told, climbed = (line.split(" | ") for line in lines[2:4])
    assert told[1] == "told what 3 episodes' logs say" and told[-1].startswith("0.30 [0.30, 0.30]")
    assert climbed[2] == "1" and climbed[-1].startswith("0.20")
    with (tmp_path / "results" / "told.csv").open() as file:
        kept = list(csv.DictReader(file))
    assert [float(row["episodes"]) for row in kept] == [3.0, 50.0, 3.0]


def test_its_settings_are_settings() -> None:
    """Training and deployments compose, and the slippery ground is within what is trained."""
    task = compose(list(TRAINING))
    assert task["params"]["draws"][9]["low"] == 0.2
    for words in WAYS.values():
        compose(["run=deploy", "checkpoint=x", "robot=quad8", *words])
