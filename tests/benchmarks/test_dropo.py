"""DROPO's benchmark: what is hidden, what its table says, the public transitions as a log."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from benchmarks import dropo
from envs.distribution import Distribution, Entry
from envs.distribution_file import read, write
from envs.effects import make
from envs.laws import Law
from envs.models import named
from envs.tasks import HopperPolito

DATA = Path(os.environ.get("SIM2REAL_DATA", ".")) / dropo.PUBLIC


def test_the_target_is_the_source_with_a_heavier_torso() -> None:
    """What is added to the source's torso makes the target's masses, and no other differs."""
    source, target = dropo.masses("source"), dropo.masses("target")
    assert target["torso"] == pytest.approx(source["torso"] + dropo.LIGHTER)
    assert dropo.truth()[1:] == pytest.approx(np.ones(3))
    assert dropo.LOW < dropo.truth()[0] < dropo.HIGH


def test_the_prior_holds_four_masses(tmp_path: Path) -> None:
    """As factors, each uniform."""
    found = read(dropo.prior(tmp_path / "prior.yaml"))
    assert found.names == tuple(f"link_mass.{name}" for name in dropo.BODIES)
    assert (found.low == dropo.LOW).all() and (found.high == dropo.HIGH).all()


def test_the_table_says_what_holds_the_truth(tmp_path: Path) -> None:
    """Three masses within their intervals, one beside it; returns stand beside the study's."""
    folder = tmp_path / "seed0"
    means = (*dropo.truth()[:3], 1.2)
    entries = [
        Entry(make("link_mass", where=body, how="scale"), (Law("normal", mean, 0.05, 0.0, 3.0),))
        for body, mean in zip(dropo.BODIES, means, strict=True)
    ]
    (folder / "identify").mkdir(parents=True)
    write(folder / "identify" / "distribution.yaml", Distribution(tuple(entries)))
    assert "| 3 of 4 |" in dropo.report(tmp_path, [0, 1], tmp_path / "results")
    (folder / "trained").mkdir()
    (folder / "trained" / "transfer.csv").write_text(
        "tested on,mean return\nsource (its own),1500\ntarget,1234.5\n"
    )
    told = dropo.report(tmp_path, [0, 1], tmp_path / "results")
    assert "| what DROPO found | 1 | 1234 |" in told
    assert all(words in told for words in dropo.BESIDE.values())
    assert (tmp_path / "results" / "dropo.csv").is_file()


@pytest.mark.skipif(not DATA.is_file(), reason=f"public transitions: set SIM2REAL_DATA ({DATA})")
def test_public_transitions_are_a_log(tmp_path: Path) -> None:
    """Two rows each, a control step apart, under one command."""
    task = HopperPolito("target", "legacy")
    model = named(task.spec()).compile()
    log = dropo.transitions(DATA, model)
    assert len(log.time) == 2 * dropo.PUBLIC_COUNT
    assert log.time[1] - log.time[0] == pytest.approx(0.008)
    assert (np.diff(log.column(f"ctrl.{model.actuator(0).name}"))[::2] == 0).all()
