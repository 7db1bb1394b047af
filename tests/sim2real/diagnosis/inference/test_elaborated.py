"""Further values of an effect that are fitted only once it is part of an answer."""

from pathlib import Path

import numpy as np
import pytest

from envs.effects import make
from sim2real.diagnosis.inference.baseline import Baseline
from sim2real.diagnosis.inference.batches import Rows, simulate_each
from sim2real.diagnosis.inference.conclusion import make_conclusion
from sim2real.diagnosis.inference.fit import Fitter, Start
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.judge import Judge
from sim2real.diagnosis.inference.moves import (
    are_compatible,
    list_elaborated,
    list_simpler,
    make_start,
)
from sim2real.diagnosis.inference.untied import untie
from sim2real.diagnosis.inference.usual import list_usual
from sim2real.diagnosis.inference.vocabulary import Vocabulary, list_effects
from sim2real.diagnosis.schema import Cause
from tests.sim2real.diagnosis import arm

NOISE, LABEL = 3e-4, "coulomb_friction.b"


def find_cause(bristle: float, folder: Path) -> Cause:
    """Return the cause that is named where a joint rubs and yields before it breaks away."""
    hidden = {"where": "b", "bristle": bristle, "ratio": 0.7}
    data = arm.data_of(arm.make_log(("coulomb_friction", hidden, 0.12), noise=NOISE), folder)
    rng = np.random.default_rng(0)
    judge = Judge(data, rng=rng)
    judgement = judge.judge(Vocabulary(data, only=[LABEL]))
    made = make_conclusion(judgement, Baseline.of(judge.replayer, rng), rng)
    assert made.report.verdict == "explained"
    assert made.alike == ()  # the same law with or without bristles is one explanation
    (cause,) = made.report.causes
    return cause


def test_a_joint_that_yields_before_it_breaks_away_says_by_how_much(tmp_path: Path) -> None:
    """Its friction is then no larger than it is."""
    cause = find_cause(2e-3, tmp_path)
    assert (cause.effect, cause.where) == ("coulomb_friction", "b")
    assert cause.value == pytest.approx(0.12, rel=0.03)  # with the bristles' usual damping
    assert cause.extra["bristle"] == pytest.approx(2e-3, rel=0.3)


def test_rigid_friction_keeps_one_value(tmp_path: Path) -> None:
    """A second one has to win its price, and does not."""
    cause = find_cause(0.0, tmp_path)
    assert cause.value == pytest.approx(0.12, rel=0.02)
    assert cause.extra["bristle"] == 0.0


def test_a_curve_that_yields_is_compared_with_dry_friction_that_does(tmp_path: Path) -> None:
    """The simpler law keeps how far the joint yields."""
    data = arm.data_of(arm.make_log(noise=NOISE), tmp_path)
    known = {one.label: one for one in list_effects(data)}
    curve, plain = known["stribeck_friction.b"], known[LABEL]
    more = plain.elaborated()
    assert more is not None
    assert curve.elaborated() is None  # its bristles are fitted from the start
    start = Start(Hypothesis((curve,)), np.array([[0.1, 0.5, 2e-3]]))
    (fit,) = Judge(data).fitter.fit([start], rounds=0)
    simpler = {one.hypothesis.label: one.points for one in list_simpler(fit, [plain, more])}
    assert set(simpler) == {LABEL, f"{LABEL} (bristle)"}
    np.testing.assert_array_equal(simpler[f"{LABEL} (bristle)"][0, 0], [0.1, 2e-3])


def test_an_effect_has_one_law_with_or_without_its_further_values(tmp_path: Path) -> None:
    """Neither the other form nor the model's own friction is added to it, nor shares its batch."""
    data = arm.data_of(arm.make_log(noise=NOISE), tmp_path)
    plain = next(one for one in list_effects(data) if one.label == LABEL)
    judge = Judge(data)
    (fit,) = judge.fitter.fit([make_start(plain)], rounds=0)
    (start,) = list_elaborated(fit)
    (member,) = start.hypothesis.members
    assert (member.label, member.law) == (f"{LABEL} (bristle)", LABEL)
    assert not are_compatible(start.hypothesis, plain)
    np.testing.assert_array_equal(start.points[:, :, 0], fit.mean[0])
    np.testing.assert_allclose(start.points[:, 0, 1], [1e-3, 4e-3])
    assert list_elaborated(judge.fitter.fit([start], rounds=0)[0]) == []
    assert LABEL not in {one.law for one in list_usual(data, start.hypothesis.effects)}
    windows, simulator = np.array([0]), judge.replayer.plain
    rows = [Rows((plain,), windows, np.array([[0.1]]))]
    rows += [Rows(start.hypothesis.effects, windows, np.array([[0.1, 0.0]]))]
    rigid, bent = simulate_each(simulator, rows)
    np.testing.assert_allclose(bent.error, rigid.error, atol=1e-9)


def test_an_effect_with_a_value_for_each_joint_keeps_its_values(tmp_path: Path) -> None:
    """They are laid out by its parts."""
    data = arm.data_of(arm.make_log(noise=NOISE), tmp_path)
    effects = list_effects(data)
    shared = next(one for one in effects if one.label == "coulomb_friction")
    each = untie(shared, effects)
    assert each is not None
    (fit,) = Judge(data).fitter.fit([Start(Hypothesis((each,)), np.array([[0.1, 0.2]]))], rounds=0)
    assert list_elaborated(fit) == []


def test_a_simpler_law_is_tried_where_a_refit_has_led(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A spring that stopped short loses to a rubbing one without friction, which is no other."""
    hidden = "joint_compliance", {"where": "b", "damping": 0.2}, 0.02
    data = arm.data_of(arm.make_log(hidden, noise=NOISE), tmp_path)
    known = {(one.name, one.effect.variant): one for one in list_effects(data) if one.place == "b"}
    side = make(hidden[0], **hidden[1]).variant
    spring, rubbing = known[hidden[0], side], known["hysteretic_compliance", side]
    own = Fitter.fit
    monkeypatch.setattr(Fitter, "fit", lambda fitter, starts, rounds=None: own(fitter, starts, 0))
    judge = Judge(data)
    short = Start(Hypothesis((spring,)), np.array([[0.004, 0.2]]))
    led = Start(Hypothesis((rubbing,)), np.array([[0.02, 0.0, 0.2]]))
    fits = {fit.label: fit for fit in judge.fitter.fit([short, led])}
    best, _ = judge._refit(fits[rubbing.label], {judge.given.label: judge.given, **fits})
    assert best.label == spring.label
    assert best.mean[0] == pytest.approx(0.02)
