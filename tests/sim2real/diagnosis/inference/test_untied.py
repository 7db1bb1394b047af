"""Joints that rub by different amounts get values of their own; joints that rub alike keep one."""

from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.inference.baseline import Baseline
from sim2real.diagnosis.inference.conclusion import Conclusion, make_conclusion
from sim2real.diagnosis.inference.fit import Start
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.judge import Judge
from sim2real.diagnosis.inference.log_changes import list_log_changes
from sim2real.diagnosis.inference.moves import are_compatible, list_untied
from sim2real.diagnosis.inference.untied import untie
from sim2real.diagnosis.inference.vocabulary import Vocabulary, list_effects
from tests.sim2real.diagnosis import arm

NOISE = 3e-4
SHARED = "coulomb_friction"


def make_rubbing(*values: float) -> Log:
    """Return a log of the arm whose joints have dry friction [N·m]."""
    pairs = zip(arm.JOINTS, values, strict=True)
    return arm.make_log(*((SHARED, {"where": n}, value) for n, value in pairs), noise=NOISE)


def conclude(log: Log, folder: Path) -> Conclusion:
    """Return the conclusion, one friction for all joints being looked at and nothing else."""
    data, rng = arm.data_of(log, folder), np.random.default_rng(0)
    judge = Judge(data, rng=rng)
    baseline = Baseline.of(judge.replayer, rng)
    return make_conclusion(judge.judge(Vocabulary(data, only=[SHARED])), baseline, rng)


def test_joints_that_rub_differently_are_causes_of_their_own(tmp_path: Path) -> None:
    """Each with its value and interval, although one for all was proposed."""
    found = conclude(make_rubbing(0.05, 0.15), tmp_path)
    causes = {cause.where: cause for cause in found.report.causes}
    assert found.report.verdict == "explained"
    assert {cause.effect for cause in causes.values()} == {SHARED}
    assert causes["a"].value == pytest.approx(0.05, rel=0.1)
    assert causes["b"].value == pytest.approx(0.15, rel=0.05)
    assert all(c.value_ci[0] < c.value < c.value_ci[1] for c in causes.values())
    assert sum(cause.closed for cause in causes.values()) > 0.9
    assert sorted(effect.label() for effect, _ in found.found) == [f"{SHARED}.a", f"{SHARED}.b"]
    assert len(found.intervals) == len(found.correlations) == 2


def test_joints_that_rub_alike_keep_one_value(tmp_path: Path) -> None:
    """Two values where one is enough have to win their price, and do not."""
    found = conclude(make_rubbing(0.1, 0.1), tmp_path)
    (cause,) = found.report.causes
    assert (cause.effect, cause.where, cause.shared) == (SHARED, None, True)
    assert cause.value == pytest.approx(0.1, rel=0.05)


def test_a_value_for_each_joint_is_laid_out_joint_by_joint(tmp_path: Path) -> None:
    """Bounds and probes are those of each; what is simulated is the effect at each joint."""
    data = arm.data_of(make_rubbing(0.1, 0.1), tmp_path)
    effects = {member.label: member for member in list_effects(data)}
    options = list(effects.values())
    many = untie(effects["stribeck_friction"], options)
    assert many is not None
    assert [part.label for part in many.parts] == ["stribeck_friction.a", "stribeck_friction.b"]
    assert len(many.neutral) == 2 * len(effects["stribeck_friction.a"].neutral)
    hypothesis = Hypothesis((effects["position_gain"], many))
    assert [m.label for m in hypothesis.effects] == [
        "position_gain",
        *(p.label for p in many.parts),
    ]
    places = [(member.label, column.start, place) for member, column, place in hypothesis.parts]
    assert places == [
        ("position_gain", 0, 0),
        ("stribeck_friction.a", 1, 1),
        ("stribeck_friction.b", 4, 1),
    ]
    ends = hypothesis.bounded(20.0)
    alone = Hypothesis((effects["position_gain"], *many.parts)).bounded(20.0)
    np.testing.assert_array_equal(ends, alone)


def test_what_is_at_one_joint_or_in_the_log_has_nothing_to_untie(tmp_path: Path) -> None:
    """Nor has what was untied, with which the same effect at one joint cannot be combined."""
    data = arm.data_of(make_rubbing(0.1, 0.1), tmp_path)
    options = list_effects(data)
    effects = {member.label: member for member in options}
    many = untie(effects[SHARED], options)
    assert many is not None
    others = [effects[f"{SHARED}.a"], effects["supply_voltage"], many, list_log_changes(data)[0]]
    assert [untie(member, options) for member in others] == [None] * len(others)
    assert not are_compatible(Hypothesis((many,)), effects[f"{SHARED}.a"])
    assert are_compatible(Hypothesis((many,)), effects["position_gain.a"])


def test_a_fit_of_values_of_their_own_begins_at_the_shared_one(tmp_path: Path) -> None:
    """So that it predicts as well from the start."""
    data = arm.data_of(make_rubbing(0.05, 0.15), tmp_path)
    judge, options = Judge(data), list_effects(data)
    effects = {member.label: member for member in options}
    shared = Hypothesis((effects["position_gain.a"], effects[SHARED]))
    (fit,) = judge.fitter.fit([Start(shared, np.array([[1.0, 0.1]]))], rounds=2)
    (start,) = list_untied(fit, options)
    assert start.hypothesis.label == f"{SHARED} (each) + position_gain.a"
    (more,) = judge.fitter.fit([start], rounds=0)
    np.testing.assert_allclose(more.mean[1:], fit.mean[1])
    assert more.total == pytest.approx(fit.total, rel=0.01)


@pytest.mark.parametrize(
    ("values", "label"), [((0.1, 0.1), SHARED), ((0.05, 0.15), f"{SHARED} (each)")]
)
def test_values_of_their_own_have_to_win_their_price(
    values: tuple, label: str, tmp_path: Path
) -> None:
    """One value for all is fitted beside them, although nobody proposed it."""
    data = arm.data_of(make_rubbing(*values), tmp_path)
    judge, options = Judge(data), list_effects(data)
    judge.choices = len(options)
    many = untie({member.label: member for member in options}[SHARED], options)
    assert many is not None
    fit = judge.fitter.fit([Start(Hypothesis((many,)), np.array([values]))])[0]
    assert judge.choose({fit.label: fit}) is fit
    assert judge._prune({fit.label: fit}, judge.fitter).label == label
