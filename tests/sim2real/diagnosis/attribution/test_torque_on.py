"""Rows with torque, told from those of swings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from envs.effects import make
from hardware.log import Log
from sim2real.diagnosis.attribution.attribute import Found, Search
from sim2real.diagnosis.attribution.candidates import Candidate, candidates
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.attribution.torque_on import refit_torque_on, with_torque
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from tests.sim2real.diagnosis import arm
from tests.sim2real.verbs.test_diagnose import make_log


def test_rows_without_torque_are_left_out(tmp_path: Path) -> None:
    """Rows are compared under torque only while every servo is on."""
    log = arm.make_log(seconds=8.0)
    on = np.ones(len(log))
    on[200:300] = 0.0
    columns = {**log.columns, "torque.a": np.ones(len(log)), "torque.b": on}
    data = arm.data_of(Log(columns, log.meta), tmp_path)
    found = with_torque(data)
    for window, row in zip(data.windows, found, strict=True):
        rows = np.arange(window.first, window.last)
        free = (rows >= 201) & (rows < 299)  # a command and its row may meet in the same step
        assert not row[: len(rows)][free].any()
        sure = window.usable & ((rows < 199) | (rows > 301))
        assert row[: len(rows)][sure].all()


@pytest.mark.slow
def test_a_law_that_fails_without_torque_is_named_and_contradicted() -> None:
    """Friction with the motor's torque alone, sought with some of the load's: wrong in swings."""
    data = Data.of(
        [
            make_log(
                {"effect": "load_dependent_friction", "where": "hinge", "value": 0.4}, seconds=16.0
            )
        ]
    )
    labels = ("load_dependent_friction.hinge", "supply_voltage", "motor_strength.hinge")
    options = [_with_one_law(c) for c in candidates(data) if c.label in labels]
    problem, rng = Problem(data, Simulator(data, threads=1)), np.random.default_rng(0)
    search = Search(problem, options, 1e-3, rng, lambda text, share: None)
    found = refit_torque_on(search, Found(search.none, search.base))
    (member,) = found.fit.members
    assert member.label == labels[0]
    assert 0.2 < found.fit.mean[0] < 0.4  # of motor's and some external torque, 0.4 of motor's
    off = data.mask & ~with_torque(data)
    assert (found.error[off] ** 2).sum() > 2 * (search.base[off] ** 2).sum()
    assert found.on(found.error)[off].sum() == 0
    fitted = refit_torque_on(search, Found(found.fit, 0.1 * search.base))
    assert fitted.seen is None  # what explains everything stays


def _with_one_law(option: Candidate) -> Candidate:
    """Return a load's friction whose part of the external torque is fixed, and wrong."""
    if not option.effect.free:
        return option
    kept = slice(0, len(option.neutral) - len(option.effect.free))
    bounds = {name: getattr(option, name)[kept] for name in ("neutral", "low", "high")}
    effect = make(option.name, where=option.effect.where, external=0.3)
    return replace(option, effect=effect, probes=option.probes[:, kept], **bounds)
