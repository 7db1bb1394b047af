"""Screening: which effects look worth a fit, alone and beside what is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim2real.diagnosis.attribution.candidates import candidates
from sim2real.diagnosis.attribution.fit import Fit, refine
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.attribution.screen import screen
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.settings import DEFAULT, Screening
from tests.sim2real.diagnosis import arm, motors, pendulum

TRUTH = (("position_gain", {"where": "b"}, 0.5), ("coulomb_friction", {"where": "a"}, 0.15))


def _probing(data: Data, most: int) -> Data:
    """Return data whose settings probe so many candidates in full."""
    return replace(data, settings=replace(DEFAULT, screening=Screening(probed_max=most)))


@pytest.mark.slow
def test_a_ripple_that_is_looked_for_elsewhere_is_screened_anew(tmp_path: Path) -> None:
    """Its probes are read off what is left: those of the first screening say nothing of them."""
    data = _probing(arm.data_of(arm.make_log(*TRUTH, seconds=4.0), tmp_path), 2)
    problem = Problem(data, Simulator(data, threads=1))
    labels = ("position_gain.b", "cogging.b", "coulomb_friction.a", "armature.a")
    known, ripple, *rest = (
        next(c for c in candidates(data) if c.label == label) for label in labels
    )
    first = screen(problem, Fit((), np.zeros((2, 0)), np.zeros(2)), [known, ripple, *rest])
    fit = Fit((known,), np.full((2, 1), 0.5), np.zeros(2))
    fewer = replace(ripple, probes=ripple.probes[:1] * [1.0, 2.0, 1.0])
    made = screen(problem, fit, [fewer, *rest], first.responses)
    seen = [r.probe.tolist() for r in made.responses if r.candidate.label == ripple.label]
    assert seen and all(probe in fewer.probes.tolist() for probe in seen)


@pytest.mark.slow
def test_beside_what_is_known_only_the_likely_are_simulated(tmp_path: Path) -> None:
    """The first screening says which; the second effect is the best of them, with the same gain."""
    data = _probing(arm.data_of(arm.make_log(*TRUTH), tmp_path), 1000)
    problem, options = Problem(data, Simulator(data, threads=1)), candidates(data)
    first = screen(problem, Fit((), np.zeros((2, 0)), np.zeros(2)), options)
    assert first.guesses[0].candidate.label == "position_gain.b"
    known = next(option for option in options if option.label == "position_gain.b")
    fit = Fit((known,), np.full((2, 1), 0.5), np.zeros(2))
    rest = [option for option in options if option is not known]
    full = screen(problem, fit, rest).guesses
    problem = Problem(_probing(data, 10), problem.simulator)
    few = screen(problem, fit, rest, first.responses).guesses
    assert few[0].candidate.label == full[0].candidate.label == "coulomb_friction.a"
    assert few[0].gain == pytest.approx(full[0].gain, rel=1e-9)
    assert len(few) < len(full) / 2
    told = [response for response in first.responses if response.candidate.name != "armature"]
    glanced = screen(problem, fit, rest, told)
    assert {"armature.a", "armature.b"} <= {r.candidate.label for r in glanced.responses}
    blind = screen(problem, fit, rest).guesses  # by their middle probes alone
    assert blind[0].candidate.label == "coulomb_friction.a"
    assert blind[0].gain == pytest.approx(full[0].gain, rel=1e-9)


@pytest.mark.slow
def test_friction_of_motors_without_a_limit_is_found(tmp_path: Path) -> None:
    """Their size comes from the logged torques, so that friction of that size is looked at."""
    data = Data.of([motors.make_log(friction=0.1, seconds=3.0)], motors.model(tmp_path))
    problem = Problem(data, Simulator(data, threads=1))
    nothing = Fit((), np.zeros((2, 0)), np.zeros(2))
    best = screen(problem, nothing, candidates(data)).guesses[0]
    assert best.candidate.label == "coulomb_friction.b"
    fit = refine(problem, (best.candidate,), np.tile(best.start, (1, 2, 1)), 4)
    assert fit.mean[0] == pytest.approx(0.1, rel=0.02)


def test_weak_motors_everywhere_are_one_cause(tmp_path: Path) -> None:
    """One strength for all of them does what two would, and is found with its value."""
    data = arm.data_of(arm.make_log(("motor_strength", {}, 0.73), seconds=6.0), tmp_path)
    problem = Problem(data, Simulator(data, threads=1))
    nothing = Fit((), np.zeros((2, 0)), np.zeros(2))
    strengths = [c for c in candidates(data) if c.name == "motor_strength"]
    best = screen(problem, nothing, strengths).guesses[0]
    assert best.candidate.label == "motor_strength"
    fit = refine(problem, (best.candidate,), np.tile(best.start, (1, 2, 1)), 4)
    assert fit.mean[0] == pytest.approx(0.73, rel=0.01)


SECOND = (("stribeck_friction", {"where": "a"}, 0.1), ("actuator_lag", {"where": "b"}, 0.004))


@pytest.mark.slow
@pytest.mark.parametrize("truth", [TRUTH, SECOND])
def test_a_glance_in_longer_steps_keeps_the_ranking(tmp_path: Path, truth: Any) -> None:
    """The first five keep their places and gains, for less work; nothing goes missing."""
    data = arm.data_of(arm.make_log(*truth, seconds=4.0), tmp_path)
    data = replace(data, settings=replace(DEFAULT, screening=Screening(kept_max=10)))
    longer = data.stepping(DEFAULT.screening.coarse_s)
    assert longer is not None
    problem, options = Problem(data, Simulator(data, threads=1)), candidates(data)
    coarse, nothing = Simulator(longer, threads=1), Fit((), np.zeros((2, 0)), np.zeros(2))
    full, exact = screen(problem, nothing, options), problem.simulator.steps
    fast = screen(problem, nothing, options, coarse=problem.by(coarse))
    steps = problem.simulator.steps - exact + coarse.steps
    assert steps < 0.75 * exact  # the arm's own steps are long: of 0.4, not 0.2 of the length
    told, kept = ([(g.candidate.label, g.gain) for g in one.guesses[:5]] for one in (full, fast))
    assert [label for label, _ in kept] == [label for label, _ in told]
    assert [gain for _, gain in kept] == pytest.approx([gain for _, gain in told], rel=1e-9)
    names = [{r.candidate.label for r in one.responses} for one in (full, fast)]
    assert names[0] == names[1] == {guess.candidate.label for guess in fast.guesses}


def test_a_glance_sees_a_soft_spring(tmp_path: Path) -> None:
    """What a stiffer one does is nothing like it, so that play looks better by middle probes."""
    soft = ("joint_compliance", {"where": "b", "side": "motor"}, 1.0)
    data = arm.data_of(arm.make_log(soft, seconds=4.0), tmp_path)
    data = replace(data, settings=replace(DEFAULT, screening=Screening(kept_max=1)))
    among = ("backlash.b (motor side)", "joint_compliance.b (motor side)", "position_gain.b")
    options = [option for option in candidates(data) if option.label in among]
    longer = data.stepping(DEFAULT.screening.coarse_s)
    assert longer is not None
    problem, nothing = (
        Problem(data, Simulator(data, threads=1)),
        Fit((), np.zeros((2, 0)), np.zeros(2)),
    )
    full = screen(problem, nothing, options).guesses[0]
    fast = screen(problem, nothing, options, coarse=problem.by(Simulator(longer, threads=1)))
    assert fast.guesses[0].candidate.label == full.candidate.label == among[1]
    assert fast.guesses[0].gain == pytest.approx(full.gain, rel=1e-9)


def test_no_glance_where_longer_steps_lose_the_motion(tmp_path: Path) -> None:
    """A servo that longer steps cannot carry is screened as it is."""
    data = arm.data_of(arm.make_log(*TRUTH, seconds=3.0), tmp_path)
    problem = Problem(data, Simulator(data, threads=1))
    options = [option for option in candidates(data) if option.name == "viscous_friction"]
    few = replace(data, settings=replace(DEFAULT, screening=Screening(kept_max=1)))
    problem = Problem(few, problem.simulator)
    lost = few.stepping(DEFAULT.screening.coarse_s)
    assert lost is not None
    for spec in lost.specs:
        spec.actuator("a").biasprm[1] *= 400
    wild = Simulator(lost, threads=1)
    nothing = Fit((), np.zeros((2, 0)), np.zeros(2))
    problem.by(wild).errors((), np.zeros((1, 2, 0)))
    once = wild.steps
    fast = screen(problem, nothing, options, coarse=problem.by(wild))
    full = screen(problem, nothing, options)
    assert [g.gain for g in fast.guesses] == [g.gain for g in full.guesses]
    assert wild.steps == once  # looked at without any probe, which is remembered, and never again


@pytest.mark.slow
@pytest.mark.parametrize("variant", [{}, {"braking": "kept"}])
def test_a_few_per_cent_of_a_voltage_are_seen(tmp_path: Path, variant: dict[str, Any]) -> None:
    """A motor that is 3 % strong swings its load elsewhere; a quarter more is no straight line."""
    where = {"where": "pivot", **variant}
    data = Data.of([pendulum.make_log(("motor_strength", where, 1.03))], pendulum.model(tmp_path))
    problem = Problem(data, Simulator(data, threads=1))
    nothing = Fit((), np.zeros((2, 0)), np.zeros(2))
    options = [c for c in candidates(data) if c.name in ("motor_strength", "link_mass")]
    best = screen(problem, nothing, options).guesses[0]
    assert best.candidate.name == "motor_strength" and best.gain > 0.8
    assert best.start[0] == pytest.approx(1.03, abs=0.01)
