"""Fits of candidates on one fold, judged on the other."""

from __future__ import annotations

import numpy as np
import pytest

from sim2real.diagnosis.attribution.candidates import Candidate, candidates
from sim2real.diagnosis.attribution.fit import Fit, refine
from sim2real.diagnosis.attribution.liveliest import tempered
from sim2real.diagnosis.attribution.pairwise import pairs
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.attribution.quantify import coalitions, intervals, shapley
from sim2real.diagnosis.attribution.screen import screen
from sim2real.diagnosis.data.score import Blocks
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis import arm

TRUTH = [("coulomb_friction", {"where": "a"}, 0.1), ("position_gain", {"where": "b"}, 0.7)]
NOTHING = Fit((), np.zeros((2, 0)), np.zeros(2))


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """The arm, one joint of which rubs while the other one is soft."""
    log = arm.make_log(*TRUTH, noise=3e-4)
    data = arm.data_of(log, tmp_path_factory.mktemp("arm"))
    return Problem(data, Simulator(data, threads=1))


@pytest.fixture(scope="module")
def options(problem: Problem) -> list[Candidate]:
    """Four candidates, the true ones among them."""
    labels = ("coulomb_friction.a", "viscous_friction.a", "position_gain.b", "motor_strength.b")
    return [c for c in candidates(problem.data) if c.label in labels]


def test_the_vocabulary_is_complete_and_excludable(problem: Problem) -> None:
    """Every effect that servos can have is there, sides apart; an excluded one is not."""
    found = {c.name for c in candidates(problem.data)}
    assert {"backlash", "command_delay", "link_mass", "profile_velocity", "supply_sag"} <= found
    assert not {"sensor_noise", "packet_loss", "ground_friction", "colour"} & found
    sides = {c.effect.side for c in candidates(problem.data) if c.name == "backlash"}
    assert sides == {"motor", "link"}
    assert "backlash" not in {c.name for c in candidates(problem.data, ["backlash"])}
    with pytest.raises(Sim2RealError, match="did you mean 'backlash'"):
        candidates(problem.data, ["backlsh"])


def test_two_effects_are_found_together(problem: Problem, options: list[Candidate]) -> None:
    """Screening ranks the true couple first, and its fit has the true values."""
    screening = screen(problem, NOTHING, options)
    best = pairs(problem, screening.base, screening.drift, screening.responses)[0]
    assert {m.label for m in best.members} == {"coulomb_friction.a", "position_gain.b"}
    fit = refine(problem, best.members, best.start[None], 4)
    found = dict(zip([m.label for m in fit.members], fit.mean, strict=True))
    assert found["coulomb_friction.a"] == pytest.approx(0.1, rel=0.05)
    assert found["position_gain.b"] == pytest.approx(0.7, rel=0.02)


def test_no_pair_takes_another_one_s_place(problem: Problem, options: list[Candidate]) -> None:
    """A pair is there once, in either order, and so is one that no log tells from another."""
    screening = screen(problem, NOTHING, options)
    other = next(c for c in candidates(problem.data) if c.label == "viscous_friction.b")
    own = list({r.candidate.label: r for r in screening.responses}.values())  # a probe of each
    strengths = [r for r in own if r.candidate.label == "motor_strength.b"]
    twins = [response._replace(candidate=other) for response in strengths]
    looked = problem, screening.base, screening.drift
    alone, found = pairs(*looked, own), pairs(*looked, [*own, *twins])
    labels = [frozenset(member.label for member in pair.members) for pair in found]
    assert len(set(labels)) == len(labels)
    twin = frozenset(("motor_strength.b", other.label))
    kept = [pair.gain for pair, label in zip(found, labels, strict=True) if label != twin]
    assert kept == pytest.approx([pair.gain for pair in alone])


def test_a_joint_bends_about_one_spring(problem: Problem) -> None:
    """A spring in all joints is paired with no spring in one of them; frictions add up."""
    options = [
        option
        for option in candidates(problem.data)
        if option.name in ("coulomb_friction", "joint_compliance")
        and option.effect.where in (None, "a")
        and option.effect.side in (None, "motor")
    ]
    screening = screen(problem, NOTHING, options)
    found = [
        pair.members
        for pair in pairs(problem, screening.base, screening.drift, screening.responses)
    ]
    springs = [[m.effect.where for m in both if m.name == "joint_compliance"] for both in found]
    assert max(map(len, springs)) == 1
    assert {"coulomb_friction", "joint_compliance"} in [{m.name for m in both} for both in found]


def test_what_is_known_may_follow_what_is_screened(
    problem: Problem, options: list[Candidate]
) -> None:
    """A friction that was found too large does not hide the gain: both are guessed together."""
    friction, gain = (
        next(c for c in options if c.name == n) for n in ("coulomb_friction", "position_gain")
    )
    known = Fit((friction,), np.full((2, 1), 0.15), np.zeros(2))
    best = screen(problem, known, [gain]).guesses[0]
    assert best.known == pytest.approx(0.1, rel=0.25)
    assert best.start == pytest.approx(0.7, rel=0.1)
    assert best.gain > 0.8


def test_a_larger_model_fits_no_worse(problem: Problem, options: list[Candidate]) -> None:
    """Nested models: an effect added at its neutral value can only lower the fitted cost."""
    friction, drag = (
        next(c for c in options if c.name == n) for n in ("coulomb_friction", "viscous_friction")
    )
    small = refine(problem, (friction,), np.array([[0.05]]))
    start = np.concatenate([small.values, np.zeros((2, 1))], axis=1)[None]
    large = refine(problem, (friction, drag), start)
    assert (large.cost <= small.cost * (1 + 1e-9)).all()


def test_shapley_shares_sum_to_all_and_intervals_cover(
    problem: Problem, options: list[Candidate]
) -> None:
    """The shares add up to what is closed; the intervals hold the truth and are not wide."""
    pair = tuple(c for c in options if c.label in ("coulomb_friction.a", "position_gain.b"))
    truth = np.array([dict((n, v) for n, _, v in TRUTH)[c.name] for c in pair])
    fit = refine(problem, pair, truth[None] * 0.9, 3)
    full = problem.held_out(fit.members, fit.values)
    errors = coalitions(problem, problem, fit, full)
    blocks = Blocks(problem.data, problem.windows, np.random.default_rng(0))
    closed = {s: 1 - blocks.rms(e) / blocks.rms(errors[frozenset()]) for s, e in errors.items()}
    shares = shapley(closed, 2)
    assert shares.sum() == pytest.approx(closed[frozenset({0, 1})])
    assert shares.min() > 0.1
    spans, together = intervals(problem, fit, np.full(2, 0.05), np.random.default_rng(0))
    assert np.diag(together) == pytest.approx([1.0, 1.0])
    assert together[0, 1] == pytest.approx(together[1, 0]) and abs(together[0, 1]) <= 1
    assert (spans[:, 0] <= truth).all() and (truth <= spans[:, 1]).all()
    assert (spans[:, 1] - spans[:, 0] < 0.3 * truth).all()


def test_a_clock_that_is_off_costs_nothing(problem: Problem, options: list[Candidate]) -> None:
    """Stamps that are half a millisecond off are set right before errors count."""
    pair = tuple(c for c in options if c.label in ("coulomb_friction.a", "position_gain.b"))
    truth = [dict((n, v) for n, _, v in TRUTH)[c.name] for c in pair]
    error, slope = problem.errors(pair, np.array([[truth, truth]]))
    late = error + 5e-4 * slope
    assert problem.cost(late, slope) == pytest.approx(problem.cost(error, slope), rel=1e-6)
    assert problem.shift(late, slope) == pytest.approx(problem.shift(error, slope) - 5e-4, abs=1e-9)


def test_another_simulator_has_its_own_clock(
    problem: Problem, options: list[Candidate], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Held-out errors are set by the clock of who simulated them, whatever was simulated before."""
    late = Simulator(problem.data, threads=1)
    run_each = late.run_each

    def delayed(runs: list) -> list:
        return [one._replace(error=one.error + 5e-4 * one.slope) for one in run_each(runs)]

    monkeypatch.setattr(late, "run_each", delayed)
    pair = tuple(c for c in options if c.label in ("coulomb_friction.a", "position_gain.b"))
    values = np.array([[dict((n, v) for n, _, v in TRUTH)[c.name] for c in pair]] * 2)
    own = problem.held_out(pair, values)
    assert np.allclose(problem.by(late).held_out(pair, values), own, atol=1e-9)


def test_intervals_are_wider_than_those_of_independent_samples(problem: Problem) -> None:
    """Errors that hang together for a second are not many samples."""
    error = problem.held_out((), np.zeros((2, 0)))
    blocks = Blocks(problem.data, problem.windows, np.random.default_rng(0))
    low, high = blocks.interval(error)
    rows = np.sqrt((error**2).mean(axis=2)[problem.data.mask])
    alone = 2 * 1.64 * rows.std() / np.sqrt(len(rows))
    assert low < blocks.rms(error) < high
    assert high - low > 2 * alone


def test_a_window_with_by_far_most_error_does_not_outweigh_the_others(problem: Problem) -> None:
    """Its weight brings it down to the others; theirs stay 1, and a fit sees weighted errors."""
    error = problem.held_out((), np.zeros((2, 0)))
    error[3] *= 30.0
    weight = tempered(problem.data, error)
    assert weight[3] < 0.3
    assert np.mean(weight == 1) > 0.7
    assert np.mean((weight[:, None, None] * error)[3] ** 2) < 3 * np.mean(error[weight == 1] ** 2)
    every = np.arange(len(problem.windows))
    plain, _ = problem.errors((), np.zeros((1, 2, 0)))
    seen, _ = problem.subset(every, weight).errors((), np.zeros((1, 2, 0)))
    assert seen[0, 3] == pytest.approx(weight[3] * plain[0, 3])
