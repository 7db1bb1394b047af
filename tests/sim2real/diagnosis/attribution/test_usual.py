"""What usual errors of a model make together, and which causes stand clear of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sim2real.diagnosis.attribution.attribute import Search
from sim2real.diagnosis.attribution.candidates import candidates
from sim2real.diagnosis.attribution.conclude import _beside_usual
from sim2real.diagnosis.attribution.fit import Problem
from sim2real.diagnosis.attribution.usual import NAMES, Usual, scaled
from sim2real.diagnosis.data.simulate import Simulator
from tests.sim2real.diagnosis import arm


def usual_of(folder: Path, *hidden: tuple[str, dict, float]) -> tuple[Search, Usual]:
    """Return a search in a log of the arm, with two candidates, and the errors of its model."""
    data = arm.data_of(arm.make_log(*hidden, noise=3e-4), folder)
    options = [c for c in candidates(data) if c.label in ("position_gain.a", "link_mass.b")]
    problem, rng = Problem(data, Simulator(data, threads=1)), np.random.default_rng(0)
    search = Search(problem, options, 3e-4, rng, lambda text, share: None)
    return search, Usual(search)


def unit_of(search: Search) -> np.ndarray:
    """Return errors of all windows whose mean square over a race's is 1, (W, T, M)."""
    size = search.problem.subset(search.racing.windows)
    shape = np.zeros_like(search.base)
    shape[search.racing.windows] = 1.0
    return shape / np.sqrt((shape**2).sum() / size.rows)


def test_their_gap_is_that_of_all_of_them_at_once(tmp_path: Path) -> None:
    """Of robots whose every factor is drawn, RMS gaps agree with it in the mean."""
    search, usual = usual_of(tmp_path)
    members = tuple(scaled(search.problem.data))
    frictions = {"coulomb_friction", "viscous_friction"}  # of which the arm's joints have none
    assert {m.name for m in members} == set(NAMES) - frictions
    assert {m.effect.how for m in members} == {"scale"} and len(members) == 2 * 3
    rng, error = np.random.default_rng(1), search.problem.data.settings.causes.usual_error
    problem = search.problem.subset(search.racing.windows)
    points = 1 + error * rng.choice([-1.0, 1.0], (24, 1, len(members))).repeat(2, axis=1)
    drawn, _ = problem.errors(members, points)
    as_given, _ = problem.errors((), np.zeros((1, 2, 0)))
    squares = ((drawn - as_given) ** 2).sum(axis=(1, 2, 3)) / problem.rows
    assert np.sqrt(squares.mean()) == pytest.approx(usual.gap, rel=0.25)


def test_only_what_closes_more_than_they_make_is_clear(tmp_path: Path) -> None:
    """A cause that closes nothing or as much as they make is not; twice as much is."""
    search, usual = usual_of(tmp_path, ("position_gain", {"where": "a"}, 0.6))
    nothing, unit = np.zeros_like(search.base), unit_of(search)
    assert usual.clear(nothing, nothing) == usual.clear(0.99 * usual.gap * unit, nothing) == 0
    assert usual.clear(1.5 * usual.gap * unit, nothing) == pytest.approx(0.5)
    assert usual.clear(2.0 * usual.gap * unit, nothing) == pytest.approx(1)
    assert usual.clear(search.base, nothing) == 1  # a servo of three fifths of its gain


def test_three_causes_have_to_stand_clear_each(tmp_path: Path) -> None:
    """Or they explain a part at best, and are doubted; of one or two nobody asks."""
    search, usual = usual_of(tmp_path, ("position_gain", {"where": "a"}, 0.6))
    nothing, unit = np.zeros_like(search.base), unit_of(search)
    large, small = 3 * usual.gap * unit, 0.9 * usual.gap * unit
    told = _beside_usual(search, "explained", [large, large, small], nothing)
    assert told == ("partly_explained", [1.0, 1.0, 0.0])
    assert _beside_usual(search, "explained", [large] * 3, nothing) == ("explained", [1.0] * 3)
    assert _beside_usual(search, "explained", [large, small], nothing)[0] == "explained"
    assert _beside_usual(search, "unexplained", [small], nothing) == ("unexplained", [0.0])
    assert _beside_usual(search, "unexplained", [], nothing) == ("unexplained", [])
