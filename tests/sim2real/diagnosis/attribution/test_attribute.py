"""The search for missing effects, step by step."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from envs.effects import make
from envs.effects.base import PLAIN
from sim2real.diagnosis.attribution import attribute
from sim2real.diagnosis.attribution.attribute import Contender, Found, Search
from sim2real.diagnosis.attribution.candidates import Candidate, candidates
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.attribution.screen import Screening, screen
from sim2real.diagnosis.attribution.suspects import meets
from sim2real.diagnosis.data.simulate import Simulator
from tests.sim2real.diagnosis import arm


def test_a_couple_is_fitted_to_the_end(tmp_path: Path) -> None:
    """Two folds that stopped far from the truth, apart, end at it, and stay once little is left."""
    truth = [("coulomb_friction", {"where": "a"}, 0.1), ("position_gain", {"where": "b"}, 0.7)]
    data = arm.data_of(arm.make_log(*truth, noise=3e-4), tmp_path)
    labels = ("coulomb_friction.a", "position_gain.b")
    members = tuple(c for label in labels for c in candidates(data) if c.label == label)
    problem = Problem(data, Simulator(data, threads=1))
    search = Search(problem, members, 3e-4, np.random.default_rng(0), lambda text, share: None)
    fit = Fit(members, np.array([[0.05, 0.85], [0.16, 0.6]]), np.zeros(2))
    found = Found(fit, problem.held_out(members, fit.values))
    search.settle(found)
    assert found.fit.values == pytest.approx(np.array([[0.1, 0.7]] * 2), rel=0.05)
    assert search.blocks.rms(found.error) < search.least
    settled = found.fit
    search.settle(found)
    assert found.fit is settled


@pytest.mark.slow
def test_where_nothing_helps_alone_two_are_tried_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each may be of no use without the other; that no single one joins is not the end."""
    truth = [("coulomb_friction", {"where": "a"}, 0.1), ("position_gain", {"where": "b"}, 0.7)]
    data = arm.data_of(arm.make_log(*truth, noise=3e-4, seconds=4.0), tmp_path)
    labels = ("coulomb_friction.a", "position_gain.b", "armature.a")
    options = [c for c in candidates(data) if c.label in labels]
    problem = Problem(data, Simulator(data, threads=1))
    joins = Search.joins

    def joins_in_pairs(self: Search, best: Contender, *more: Any) -> bool:
        return len(best.fit.members) > 1 and joins(self, best, *more)

    race, beside = Search.race, []

    def noted(self: Search, fit: Fit, *more: Any) -> list[Contender]:
        beside.append(len(fit.members))
        return race(self, fit, *more)

    monkeypatch.setattr(Search, "joins", joins_in_pairs)
    monkeypatch.setattr(Search, "race", noted)
    search = Search(problem, options, 3e-4, np.random.default_rng(0), lambda text, share: None)
    found = search.ahead()
    assert {m.label for m in found.fit.members} == set(labels[:2])
    assert beside == [0]  # they close the gap: nobody races for a third place
    monkeypatch.setattr(Search, "joins", lambda *arguments: False)
    search = Search(problem, options, 3e-4, np.random.default_rng(0), lambda text, share: None)
    assert not search.ahead().fit.members  # and if they do not help either, it ends


def test_a_second_effect_is_looked_for_where_it_shows(tmp_path: Path) -> None:
    """Windows follow what is left; what was screened first stays in view of the race."""
    truth = ("coulomb_friction", {"where": "a"}, 0.1)
    data = arm.data_of(arm.make_log(truth, seconds=36.0), tmp_path)
    problem = Problem(data, Simulator(data, threads=1))
    search = Search(problem, (), 3e-4, np.random.default_rng(0), lambda text, share: None)
    assert search.stages(search.base) == (search.screening, search.racing)
    others = np.setdiff1d(problem.windows, search.screening.windows)
    worst = [next(w for w in others if data.fold[w] == fold) for fold in (0, 1)]
    left = np.zeros_like(search.base)
    left[worst] = 1.0
    screening, racing = search.stages(left)
    assert set(worst) <= set(screening.windows)
    assert {*worst, *search.screening.windows} <= set(racing.windows)


def test_only_what_moves_the_same_joint_can_take_a_place() -> None:
    """A neighbour's friction cannot stand for an elbow's; a body it carries, or a delay, can."""

    def option(name: str, joint: str | None, *shown: str) -> Candidate:
        empty = np.zeros((1, 1))
        effect = make(name, where=joint)
        return Candidate(effect, joint, empty, *np.zeros((3, 1)), group="", shown=shown)

    elbow = option("coulomb_friction", "elbow", "elbow")
    assert not meets(option("armature", "wrist", "wrist"), elbow)
    assert meets(option("link_mass", "hand", "elbow", "wrist"), elbow)
    assert meets(option("command_delay", None), elbow)


@pytest.mark.slow
def test_a_promise_is_no_judge(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a linear look ranks fifteenth races too, and wins if it closes the gap."""
    data = arm.data_of(arm.make_log(("motor_strength", {"where": "a"}, 0.6), noise=3e-4), tmp_path)
    problem = Problem(data, Simulator(data, threads=1))
    options = [option for option in candidates(data) if option.group == PLAIN]
    search = Search(problem, options, 3e-4, np.random.default_rng(0), lambda text, share: None)

    def misled(*arguments: Any) -> Screening:
        made = screen(*arguments)
        truth = next(g for g in made.guesses if g.candidate.label == "motor_strength.a")
        others = [guess for guess in made.guesses if guess is not truth and guess.gain > 0.0]
        low = truth._replace(gain=others[13].gain)
        return made._replace(guesses=[*others[:14], low, *others[14:]])

    monkeypatch.setattr(attribute, "screen", misled)
    assert search.race(search.none, search.base)[0].candidate.label == "motor_strength.a"


@pytest.mark.parametrize(("left", "count"), [(0.45, 1), (0.3, 2)])
def test_a_further_effect_has_to_pay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, left: float, count: int
) -> None:
    """What closes a twentieth where most is left only mends a bad fit, and ends the search."""
    data = arm.data_of(arm.make_log(("coulomb_friction", {"where": "a"}, 0.1)), tmp_path)
    labels = ("coulomb_friction.a", "position_gain.a")
    options = [c for label in labels for c in candidates(data) if c.label == label]
    problem = Problem(data, Simulator(data, threads=1))
    search = Search(problem, options, 3e-4, np.random.default_rng(0), lambda text, share: None)
    shares = iter([0.5, left])

    def race(fit: Fit, error: np.ndarray, found: Found) -> list[Contender]:
        share = next(shares, None)
        if not share:
            return []
        option = options[len(fit.members)]
        more = Fit((*fit.members, option), np.ones((2, len(fit.members) + 1)), np.zeros(2))
        wrong = share * search.base * np.array([1.0, 0.0])
        return [Contender(option, more, wrong)]

    monkeypatch.setattr(search, "race", race)
    monkeypatch.setattr(search, "polish", lambda best: best)
    for step in ("pair", "back"):
        monkeypatch.setattr(search, step, lambda found: None)
    assert len(search.run().fit.members) == count
