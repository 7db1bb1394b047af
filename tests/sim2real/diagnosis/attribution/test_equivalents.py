"""What may stand in a cause's place: found by what it does to the logs, or known in principle."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.attribution.attribute import Contender, Found, Search
from sim2real.diagnosis.attribution.candidates import Candidate, candidates
from sim2real.diagnosis.attribution.conclude import conclude
from sim2real.diagnosis.attribution.equivalents import explanations, inseparable, with_rivals
from sim2real.diagnosis.attribution.fit import Fit
from sim2real.diagnosis.attribution.problem import FOLDS, Problem
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.settings import DEFAULT, Verdict
from tests.sim2real.diagnosis import arm

FLOOR = 3e-4


def search_of(log: Log, folder: Path, *among: str) -> Search:
    """Return a search among candidates of some labels."""
    data = Data.of([log], arm.model(folder))
    options = [c for c in candidates(data) if c.label in among]
    problem, rng = Problem(data, Simulator(data, threads=1)), np.random.default_rng(0)
    return Search(problem, options, FLOOR, rng, lambda text, share: None)


def option(search: Search, label: str) -> Candidate:
    """Return one of a search's candidates."""
    return next(o for o in search.options if o.label == label)


DELAYS = ("command_delay", "observation_delay")


def test_delays_are_always_named_together(tmp_path: Path) -> None:
    """A log without stamps of readings cannot say which one it is, and neither can the next."""
    log = arm.make_log(("observation_delay", {}, 0.03), seconds=4.0, noise=FLOOR)
    search = search_of(log, tmp_path, *DELAYS)
    made = conclude(search, search.run(), np.full(2, FLOOR), np.random.default_rng(0))
    (cause,) = made.report.causes
    (other,) = cause.equivalent
    assert {cause.effect, other.effect} == set(DELAYS)
    assert other.inseparable
    assert cause.value == pytest.approx(0.03, abs=2e-3)
    assert made.alike == ()  # there is nothing to record


def test_a_drifting_clock_is_neither_a_delay_nor_a_tilt(tmp_path: Path) -> None:
    """None of them changes a number of the model's bodies or motors, and yet they differ."""
    names = ("clock_drift", "command_delay", "gravity_tilt")
    search = search_of(arm.make_log(seconds=4.0), tmp_path, *names)
    drift = option(search, "clock_drift"), np.array([0.02])
    late = option(search, "command_delay"), np.array([0.02])
    tilt = option(search, "gravity_tilt"), np.array([0.02, 0.02])
    for other in (late, tilt):
        assert not inseparable(search, drift, other) and not inseparable(search, other, drift)


def test_stamps_of_all_readings_part_delays(tmp_path: Path) -> None:
    """With the moments at which each joint was read they are two things."""
    log = arm.make_log(seconds=4.0)
    pair = [(option(search_of(log, tmp_path, *DELAYS), n), np.array([0.02])) for n in DELAYS]
    assert inseparable(search_of(log, tmp_path, *DELAYS), *pair)
    stamps = {f"stamp.{joint}": log.time for joint in "ab"}
    stamped = search_of(Log({**log.columns, **stamps}), tmp_path, *DELAYS)
    assert not inseparable(stamped, *pair)


def test_what_makes_one_model_is_one_member(tmp_path: Path) -> None:
    """Motors without damping of their own are as weak as their supply; these are damped."""
    log, labels = arm.make_log(seconds=4.0), ("motor_strength", "supply_voltage", "position_gain")
    labels += ("command_delay",)
    search = search_of(log, tmp_path, *labels)
    weak, supply, gain = ((option(search, label), np.array([0.7])) for label in labels[:3])
    assert not inseparable(search, weak, supply)
    for spec in search.problem.data.specs:
        for actuator in spec.actuators:
            actuator.damping[:] = 0.0
    assert inseparable(search, weak, supply)
    assert inseparable(search, weak, (supply[0], np.array([0.3])))  # fitted badly
    assert not inseparable(search, weak, gain)  # a gain has no limit
    late = option(search, "command_delay"), np.array([0.02])  # cannot be as large as a factor
    assert not inseparable(search, weak, late)


@pytest.mark.slow
def test_what_no_log_can_part_is_no_reason_to_doubt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A twin that follows to the digit is the same answer: it is named, and costs no confidence."""
    undamped = re.sub(r' damping="[0-9.]+"', "", arm.XML)
    monkeypatch.setattr(arm, "XML", undamped.replace("armature", 'damping="0.3" armature'))
    log = arm.make_log(("motor_strength", {}, 0.8), noise=FLOOR)
    labels = ("motor_strength", "supply_voltage", "coulomb_friction.a")
    search = search_of(log, tmp_path, *labels)
    made = conclude(search, search.run(), np.full(2, FLOOR), np.random.default_rng(0))
    (cause,) = made.report.causes
    (other,) = cause.equivalent
    assert {cause.effect, other.effect} == {"motor_strength", "supply_voltage"}
    assert other.inseparable
    assert cause.confidence > 0.9


@pytest.mark.slow
def test_values_that_never_raced_have_their_look_alikes(tmp_path: Path) -> None:
    """Of fitted values each is told with what points where it points, fitted in its place."""
    log = arm.make_log(("link_mass", {"where": "lower"}, 0.2), noise=FLOOR)
    labels = ("link_mass.lower", "payload.lower", "armature.a", "coulomb_friction.b")
    search = search_of(log, tmp_path, *labels)
    many = replace(DEFAULT, verdict=Verdict(causes_max=0))  # one value is too many to race
    search.problem.data = replace(search.problem.data, settings=many)
    search.race(search.none, search.base)
    member, values = option(search, "link_mass.lower"), np.full((FOLDS, 1), 0.2)
    fit = Fit((member,), values, np.zeros(FOLDS))
    found = Found(fit, search.problem.held_out((member,), values))
    own, *others = with_rivals(search, found).rivals[member.label]
    assert own.candidate is member
    assert [c.candidate.label for c in others] == ["payload.lower"]
    assert all(c.settled for c in (own, *others))
    assert search.blocks.rms(others[0].error) < 0.2 * search.before


@pytest.mark.slow
def test_a_twin_that_was_screened_far_from_its_value_is_named(tmp_path: Path) -> None:
    """Three times a link's inertia is answered by a rotor; the link, probed at 1.8, is with it."""
    log = arm.make_log(("link_inertia", {"where": "upper"}, 3.06), noise=FLOOR)
    search = search_of(log, tmp_path, "armature.a", "coulomb_friction.a")
    found = search.run()
    (member,) = found.fit.members
    assert member.label == "armature.a"
    search.options = search_of(log, tmp_path, "armature.a", "link_inertia.upper").options
    made = conclude(search, found, np.full(2, FLOOR), np.random.default_rng(0))
    (cause,) = made.report.causes
    (other,) = cause.equivalent
    assert (other.effect, other.where, other.inseparable) == ("link_inertia", "a", True)
    (rival,) = (r for r in with_rivals(search, found).rivals[member.label] if r.candidate != member)
    assert rival.fit.mean == pytest.approx([3.06], rel=0.02)


def test_all_that_is_open_is_told_apart_at_once(tmp_path: Path) -> None:
    """Two causes with a rival each: each is replaced in its turn, beside the other as found."""
    labels = ("coulomb_friction.a", "stribeck_friction.a", "armature.b", "link_mass.lower")
    search = search_of(arm.make_log(seconds=4.0), tmp_path, *labels)
    rubs, sticks, rotor, heavy = (option(search, label) for label in labels)
    fit = Fit((rubs, rotor), np.tile([0.1, 0.02], (FOLDS, 1)), np.zeros(FOLDS))

    def contender(one: Candidate, *values: float) -> Contender:
        return Contender(
            one, Fit((one,), np.tile(values, (FOLDS, 1)), np.zeros(FOLDS)), search.base
        )

    sets = [[contender(sticks, 0.1, 0.3)], [contender(heavy, 0.2)]]
    found = explanations(fit, sets)
    assert [label for label, _ in found] == [
        "coulomb_friction.a with armature.b",
        "stribeck_friction.a with armature.b",
        "coulomb_friction.a with link_mass.lower",
    ]
    assert found[1][1].mean == pytest.approx([0.02, 0.1, 0.3])
    assert explanations(fit, [[], []]) == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "more", "value", "alike"),
    [
        ("encoder_eccentricity", {"phase": 1.7}, 0.2, True),
        ("encoder_offset", {}, 0.05, False),  # no sine is as flat
    ],
)
def test_an_eccentric_encoder_may_pass_for_a_shifted_one(
    tmp_path: Path, hidden: str, more: dict, value: float, alike: bool
) -> None:
    """Where a joint turns little it is no candidate, but named beside what it passes for."""
    log = arm.make_log((hidden, {"where": "a", **more}, value), noise=1e-3, seconds=4.0)
    search = search_of(log, tmp_path, "encoder_offset.a", "coulomb_friction.a")
    data = search.problem.data
    assert "encoder_eccentricity" not in {o.name for o in candidates(data)}
    assert not candidates(data, ["encoder_eccentricity"], standing_in=True)
    search.stand_ins = candidates(data, standing_in=True)
    assert {o.label for o in search.stand_ins} == {f"encoder_eccentricity.{j}" for j in "ab"}
    made = conclude(search, search.run(), np.full(2, FLOOR), np.random.default_rng(0))
    cause = made.report.causes[0]
    assert (cause.effect, cause.where) == ("encoder_offset", "a")
    told = [(e.effect, e.where, e.inseparable) for e in cause.equivalent]
    assert told == ([("encoder_eccentricity", "a", False)] if alike else [])
