"""A push that no command tells, and readings that are off for a moment: where, when, how much."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from envs.plant import Plant
from envs.replay import rollout
from hardware.log import Log
from sim2real.diagnosis.inference.baseline import Baseline
from sim2real.diagnosis.inference.conclusion import make_conclusion
from sim2real.diagnosis.inference.events import GLITCH, PUSH, Event, Push, find_events
from sim2real.diagnosis.inference.judge import Judge
from sim2real.diagnosis.inference.vocabulary import Vocabulary
from tests.sim2real.diagnosis import arm

START, END, TORQUE, NOISE = 5.02, 5.22, 1.5, 3e-4


def pushed(torque: float) -> Log:
    """Return a log of the arm whose second joint is pushed once, for a fifth of a second."""
    log = arm.make_log(noise=NOISE)
    plant = Plant(arm.spec(), [Push("b", start=START, end=END)], 1, threads=1)
    every, ctrl = np.zeros(1, int), np.column_stack([log.columns[f"ctrl.{n}"] for n in arm.JOINTS])
    plant.set_params(every, np.array([[torque]]))
    start = np.zeros((1, 2))
    plant.reset(every, start, start, np.zeros(1, np.uint64), ctrl[:1], measured=True)
    per = round(1 / arm.RATE / arm.STEP)
    path = rollout(plant, ctrl.repeat(per, axis=0)[None])[0, :-1:per]
    path += NOISE * np.random.default_rng(1).normal(size=path.shape)
    return Log({**log.columns, **{f"qpos.{n}": path[:, i] for i, n in enumerate(arm.JOINTS)}})


def found_by(judge: Judge) -> tuple[Event, ...]:
    """Return the pushes in all that the model as given leaves."""
    left = judge.excess(judge.given.held)
    return find_events(judge.fitter, judge.given, left, left)


def test_a_push_is_located(tmp_path: Path) -> None:
    """At its joint, within a tenth of a second, about as hard as it was."""
    judge = Judge(arm.data_of(pushed(TORQUE), tmp_path))
    (found,) = found_by(judge)
    assert (found.effect, found.joint, found.rival) == (PUSH, "b", None)
    np.testing.assert_allclose(found.seconds, (START, END), atol=0.12)
    impulse = found.size * (found.seconds[1] - found.seconds[0])
    assert impulse == pytest.approx(TORQUE * (END - START), rel=0.4)
    assert found.evidence > 100


@pytest.mark.parametrize("width", [0.02, 0.1, 0.3])
def test_readings_that_jump_and_jump_back_are_no_push(width: float, tmp_path: Path) -> None:
    """No torque moves a joint at once; where, when and by how much they are off is known."""
    log = arm.make_log(noise=NOISE)
    bump = np.where((log.time >= 5.0) & (log.time <= 5.0 + width), -0.1, 0.0)
    wrong = Log({**log.columns, "qpos.a": log.columns["qpos.a"] + bump})
    (found,) = found_by(Judge(arm.data_of(wrong, tmp_path)))
    assert (found.effect, found.joint, found.rival) == (GLITCH, "a", None)
    np.testing.assert_allclose(found.seconds, (5.0, 5.0 + width), atol=0.05)
    assert found.size == pytest.approx(-0.1, rel=0.1)


def test_no_push_is_no_evidence(tmp_path: Path) -> None:
    """Nor is an effect that acts throughout: it leaves something in every window."""
    log = arm.make_log(("coulomb_friction", {"where": "b"}, 0.12), noise=NOISE)
    judge = Judge(arm.data_of(log, tmp_path))
    assert found_by(judge) == ()


@pytest.mark.parametrize("turns", [("root.4", "b"), ("root.4", "root.5")])
def test_a_turn_of_the_base_is_not_pushed(turns: tuple[str, str], tmp_path: Path) -> None:
    """It is compared as a joint is, but the model has no joint of its name."""
    judge = Judge(arm.data_of(pushed(TORQUE), tmp_path))
    joints = tuple(j._replace(name=name) for j, name in zip(judge.data.joints, turns, strict=True))
    judge.replayer.data = replace(judge.replayer.data, joints=joints)
    found = found_by(judge)
    assert [one.joint for one in found] == [name for name in turns if name == "b"]


def test_a_push_that_holds_little_of_the_gap_is_no_cause(tmp_path: Path) -> None:
    """What an explanation leaves has to be worth one: a share of the gap that was given."""
    judge = Judge(arm.data_of(pushed(TORQUE), tmp_path))
    small = replace(judge.given, held=judge.given.held / 3)
    left, whole = judge.excess(small.held), judge.excess(judge.given.held)
    assert 0 < left.sum() < whole.sum() / 9
    assert find_events(judge.fitter, small, left, left)
    assert not find_events(judge.fitter, small, left, whole)


def test_a_judgement_names_a_push(tmp_path: Path) -> None:
    """What no change explains is looked for in moments, and part of the gap is explained."""
    data = arm.data_of(pushed(TORQUE), tmp_path)
    judgement = Judge(data).judge(
        Vocabulary(data, only=["coulomb_friction.a", "viscous_friction.b"])
    )
    assert [one.joint for one in judgement.events] == ["b"]
    assert judgement.verdict == "partly_explained"


def test_what_explains_the_moment_once_fitted_to_it_is_no_less_likely(tmp_path: Path) -> None:
    """No other stretch tells such an effect from a push; friction explains no push."""
    data, rng = arm.data_of(pushed(TORQUE), tmp_path), np.random.default_rng(0)
    judge = Judge(data)
    vocabulary = Vocabulary(data, only=["coulomb_friction.a", "viscous_friction.b"])
    judgement = judge.judge(vocabulary)
    baseline = Baseline.of(judge.replayer, rng)
    (cause,) = make_conclusion(judgement, baseline, rng).report.causes
    assert (cause.effect, cause.where, cause.equivalent) == ("push", "b", ())
    rivals = judge.fitter.fit(vocabulary.list_starts(judge.replay_errors(judge.given), "ab"))
    fitted = [replace(one, own=0 * one.own) for one in rivals]
    (cause,) = make_conclusion(replace(judgement, rivals=(*fitted,)), baseline, rng).report.causes
    assert ("viscous_friction", "b") in {(one.effect, one.where) for one in cause.equivalent}


def test_a_push_acts_within_its_moments_alone(tmp_path: Path) -> None:
    """Before it begins nothing differs, bit for bit."""
    log, other = pushed(0.0), pushed(TORQUE)
    early = log.time <= START
    np.testing.assert_array_equal(log.columns["qpos.b"][early], other.columns["qpos.b"][early])
    assert np.abs(log.columns["qpos.b"] - other.columns["qpos.b"]).max() > 10 * NOISE
