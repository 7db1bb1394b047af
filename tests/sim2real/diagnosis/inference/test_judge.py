"""The judge on the arm of the tests: mistakes of the log, effects of the robot, nothing at all."""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.inference.fit import Fit, Start
from sim2real.diagnosis.inference.hypotheses import NONE, Hypothesis, Member
from sim2real.diagnosis.inference.judge import Judge, Judgement
from sim2real.diagnosis.inference.likelihood import Likelihood
from sim2real.diagnosis.inference.log_changes import list_log_changes
from sim2real.diagnosis.inference.moves import join_members, make_start
from sim2real.diagnosis.inference.remainder import describe_remainder
from sim2real.diagnosis.inference.vocabulary import Vocabulary
from tests.sim2real.diagnosis import arm

NOISE = 3e-4
FRICTION = ("coulomb_friction", {"where": "b"}, 0.12)
LATE = ("command_delay", {}, 0.03)
BOTH = ("ctrl", "qpos", "ctrl.qpos")
PROPOSED = ("coulomb_friction.a", "coulomb_friction.b", "viscous_friction.b", "position_gain.b")


def judged(log: Log, folder: Path) -> Judgement:
    """Return what the judge says of a log, a few effects of the robot proposed."""
    data = arm.data_of(log, folder)
    changes = [change.label for change in list_log_changes(data)]
    return Judge(data).judge(Vocabulary(data, only=[*PROPOSED, *changes]))


def with_columns(log: Log, **columns: np.ndarray) -> Log:
    """Return a log with other columns; `_` stands for the dot."""
    return Log({**log.columns, **{n.replace("_", "."): v for n, v in columns.items()}})


def test_nothing_hidden_is_no_gap(tmp_path: Path) -> None:
    """The starts' noise and the encoder's leave nothing for a discrepancy."""
    judgement = judged(arm.make_log(noise=NOISE), tmp_path)
    assert judgement.verdict == "no_gap"
    assert judgement.best.hypothesis.members == ()


def test_moments_that_may_be_left_count_nowhere(tmp_path: Path, monkeypatch) -> None:
    """Neither in what a discrepancy gains nor in the errors that an explanation has to shorten."""
    judge = Judge(arm.data_of(arm.make_log(seconds=60.0, noise=NOISE), tmp_path))
    count = len(judge.given.held)
    few = int(judge.settings.moments * count)
    assert 0 < few < count
    gains = np.where(np.arange(count) < few, 1e6, 0.0)
    monkeypatch.setattr(judge, "left_in_windows", lambda fit: gains)
    noise, many = judge.replayer.used[..., None] * judge.replayer.noise, gains[:, None, None] > 0
    judge.given = replace(judge.given, held=np.where(many, 90, 9) * noise)
    left = judge.left(replace(judge.given, held=np.where(many, 900, 3) * noise))
    assert left.closes == pytest.approx((9 - 3) / (9 - 1))
    assert left.gain == (0.0, 0.0, 0.0)
    assert left.whole > 1.0


def test_what_differs_by_less_than_a_count_is_not_distinguished(tmp_path: Path) -> None:
    """However many readings there are: a model that is off by as much counts as right."""
    judge = Judge(arm.data_of(arm.make_log(seconds=60.0, noise=NOISE), tmp_path))
    size = np.minimum(judge.most, 1.0) * judge.replayer.noise
    wave = size * np.sin(9 * judge.replayer.times)[..., None]
    off = [judge.given.own + share * wave for share in (0.5, 4.0)]
    near, far = (judge.fitter.judge(NONE, np.zeros((2, 0)), (e, e)) for e in off)
    assert judge.bootstrap.gain(judge.given.score - near.score).low > 0
    assert not judge.distance.distinguishes(judge.given, near)
    assert judge.distance.distinguishes(judge.given, far)


def test_sound_joints_do_not_hide_one_that_is_not(tmp_path: Path, monkeypatch) -> None:
    """What is left is asked of every joint: the mean over all of them would pass."""
    judge = Judge(arm.data_of(arm.make_log(seconds=60.0, noise=NOISE), tmp_path))
    tolerance = judge.settings.equivalence_tolerance
    share = 1.5 * tolerance * judge.rows / len(judge.fold)  # nats a window, all of them at b

    def score_within(fit: Fit, ranges: Sequence[Any], near: bool = False) -> np.ndarray:
        return np.stack([fit.score - (share if np.isfinite(m[1]) else 0.0) for _, m in ranges])

    monkeypatch.setattr(judge.fitter, "score_within", score_within)
    left = judge.left(judge.given)
    assert left.gain.high < tolerance < left.worst.high
    assert not judge.explains(judge.given)


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [(), (FRICTION,)])
def test_a_late_row_is_named_with_and_without_an_effect_beside(
    hidden: tuple, tmp_path: Path
) -> None:
    """Commands that stand a row late are no negative friction; friction beside them stays one."""
    log = arm.make_log(*hidden, seconds=12.0, noise=NOISE)
    late = {
        f"ctrl_{n}": np.append(log.columns[f"ctrl.{n}"][:1], log.columns[f"ctrl.{n}"][:-1])
        for n in arm.JOINTS
    }
    judgement = judged(with_columns(log, **late), tmp_path)
    named = {m.label for m in judgement.best.hypothesis.members}
    assert judgement.verdict == "explained"
    assert named == {"log.row_shift.ctrl", *(("coulomb_friction.b",) if hidden else ())}
    if hidden:
        np.testing.assert_allclose(judgement.best.mean[0], FRICTION[2], rtol=0.03)


@pytest.mark.slow
def test_degrees_in_one_column_are_named_for_what_they_are(tmp_path: Path) -> None:
    """Judged by unknowns of its own: windows that start at 30 rad would speak against it."""
    log = arm.make_log(noise=NOISE)
    data = arm.data_of(with_columns(log, qpos_b=np.degrees(log.columns["qpos.b"])), tmp_path)
    only = [f"log.{kind}.{columns}.b" for kind in ("unit", "scale") for columns in BOTH]
    judgement = Judge(data).judge(Vocabulary(data, only=[*PROPOSED, *only, "log.turn.qpos.b"]))
    assert judgement.verdict == "explained"
    assert judgement.best.label == "log.unit.qpos.b"


def test_a_reversed_joint_is_named_with_its_mirror_image(tmp_path: Path) -> None:
    """An arm whose other joint is reversed is this one in a mirror: no log tells them apart.

    Each is judged by unknowns of its own: those of the other's starts would cost it dearly.
    """
    log = arm.make_log(noise=NOISE)
    turned = {f"{kind}_b": -log.columns[f"{kind}.b"] for kind in ("ctrl", "qpos")}
    data = arm.data_of(with_columns(log, **turned), tmp_path)
    labels = [f"log.reversal.ctrl.qpos.{name}" for name in arm.JOINTS]
    judgement = Judge(data).judge(Vocabulary(data, only=labels))
    assert judgement.verdict == "explained"
    totals = {fit.label: fit.total for fit in (judgement.best, *judgement.rivals)}
    assert totals[labels[0]] == pytest.approx(totals[labels[1]], abs=0.5)  # nats
    assert judgement.best.total > judgement.given.total + 1000


@pytest.mark.parametrize(
    "name", ["supply_voltage", pytest.param("motor_strength", marks=pytest.mark.slow)]
)
def test_a_motor_that_is_off_by_two_per_cent_is_no_gap(name: str, tmp_path: Path) -> None:
    """No motor is known better, be it by its voltage or, with its braking, by its constant."""
    judgement = judged(arm.make_log((name, {}, 0.98), noise=NOISE), tmp_path)
    assert judgement.verdict == "no_gap"


def test_a_gain_that_is_off_by_more_than_usual_is_a_gap_without_a_name_too(
    tmp_path: Path,
) -> None:
    """That errors of parameters explain it is no excuse where they are larger than usual."""
    hidden = ("position_gain", {"where": "b"}, 0.85)
    data = arm.data_of(arm.make_log(hidden, noise=NOISE), tmp_path)
    judgement = Judge(data).judge(Vocabulary(data, only=["coulomb_friction.a"]))
    left = judgement.judge.left(judgement.given)
    assert left.worst.high < data.settings.inference.equivalence_tolerance
    assert judgement.verdict == "unexplained"
    assert "off by more than usual would explain it" in describe_remainder(judgement)


@pytest.mark.slow
def test_a_clock_that_speeds_contradict_comes_before_what_imitates_it(tmp_path: Path) -> None:
    """Less inertia and a weaker motor move an arm as a slow clock would: not so its speeds."""
    hidden = [("motor_strength", {"where": name}, 0.8) for name in arm.JOINTS]
    log = arm.make_log(*hidden, noise=NOISE)
    speeds = {f"qvel_{n}": np.gradient(log.columns[f"qpos.{n}"], log.time) for n in arm.JOINTS}
    data = arm.data_of(with_columns(log, time=0.8 * log.time, **speeds), tmp_path)
    effects = ("motor_strength", "armature", "position_gain", "center_of_mass")
    every = {member.label for member in Vocabulary(data, log=False).effects}
    only = {label for label in every if label.startswith(effects)} | {"log.clock.time"}
    judgement = Judge(data).judge(Vocabulary(data, only=only))
    assert "log.clock.time" in [member.label for member in judgement.best.hypothesis.members]
    place = [m.label for m in judgement.best.hypothesis.members].index("log.clock.time")
    value = judgement.best.mean[judgement.best.hypothesis.columns[place]]
    np.testing.assert_allclose(value, 0.8, rtol=0.01)


@pytest.mark.slow
def test_an_effect_that_nobody_proposes_stays_unexplained_or_in_part(tmp_path: Path) -> None:
    """A law that is not in the vocabulary: the posterior says so."""
    log = arm.make_log(("cogging", {"where": "a", "count": 9.0}, 0.3), seconds=12.0, noise=NOISE)
    judgement = judged(log, tmp_path)
    assert judgement.verdict in ("unexplained", "partly_explained")
    assert judgement.unknown > 0.5


def test_an_effect_that_a_mistake_of_the_log_equals_is_named(tmp_path: Path) -> None:
    """A zero that is off in command and reading is the robot's: nothing tells the two apart."""
    log = arm.make_log(("encoder_offset", {"where": "b"}, 0.2), noise=NOISE)
    data = arm.data_of(log, tmp_path)
    labels = ["encoder_offset.b", "log.offset.ctrl.qpos.b"]
    judgement = Judge(data).judge(Vocabulary(data, only=labels))
    assert judgement.verdict == "explained"
    assert judgement.best.label == labels[0]
    assert labels[1] in {fit.label for fit in judgement.rivals}


def fit_of(judge: Judge, member: Member, gained: float) -> Fit:
    """Return a fit of one member that wins so much [nats a row]."""
    hypothesis = Hypothesis((member,))
    gain = gained * judge.rows / len(judge.given.score)
    values = np.zeros((2, len(hypothesis.low)))
    return replace(
        judge.given, hypothesis=hypothesis, values=values, score=judge.given.score + gain
    )


def test_more_values_have_to_pay_for_themselves(tmp_path: Path) -> None:
    """Two values that win a little more than one, but not their price, do not displace it."""
    data = arm.data_of(arm.make_log(noise=NOISE), tmp_path)
    judge, members = Judge(data), {m.label: m for m in Vocabulary(data).members}
    judge.choices = len(members)
    one, two = members["encoder_offset.b"], members["gravity_tilt"]
    price = judge.price(Hypothesis((one,)))
    fits = [fit_of(judge, one, price + 0.010), fit_of(judge, two, price + 0.015)]
    assert judge.price(fits[1].hypothesis) > price + 0.015
    assert judge.choose({fit.label: fit for fit in fits}) is fits[0]


@pytest.mark.parametrize(("nats", "robot"), [(0.1, True), (20.0, False)])
def test_a_fit_is_known_to_what_ends_it(nats: float, robot: bool, tmp_path: Path) -> None:
    """A mistake of the log that wins less than that is the effect that it equals."""
    data = arm.data_of(arm.make_log(noise=NOISE), tmp_path)
    judge, members = Judge(data), {m.label: m for m in Vocabulary(data).members}
    judge.choices = len(members)
    effect, mistake = members["encoder_offset.b"], members["log.offset.ctrl.qpos.b"]
    least = judge.price(Hypothesis((effect,))) + 0.01
    fits = [fit_of(judge, effect, least), fit_of(judge, mistake, least + nats / judge.rows)]
    assert judge.choose({fit.label: fit for fit in fits}) is fits[0 if robot else 1]


def test_the_search_ends_where_no_longer_explanation_wins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever of two equals is the best for the moment: it looks again at longer ones only."""
    data = arm.data_of(arm.make_log(FRICTION, noise=NOISE), tmp_path)
    judge, vocabulary = Judge(data), Vocabulary(data, only=PROPOSED)
    refined, chosen = [], itertools.cycle("ab")
    monkeypatch.setattr(judge, "is_enough", lambda fit: False)
    own = judge.search.refine

    def refine(best: Fit, starts: Sequence[Start], tried: dict[str, Fit]) -> None:
        refined.append(best.label)
        own(best, starts, tried)

    def choose(tried: dict[str, Fit]) -> Fit:
        singles = [fit for fit in tried.values() if len(fit.hypothesis.members) == 1]
        return singles[next(chosen) == "a"]

    monkeypatch.setattr(judge.search, "refine", refine)
    monkeypatch.setattr(judge, "choose", choose)
    judge.find(vocabulary)
    assert len(refined) == 2 and refined[0] == judge.given.label


def fit_delays(judge: Judge) -> tuple[list[Fit], dict[str, Member]]:
    """Return fits of a late command and of late readings, and all members."""
    members = {m.label: m for m in Vocabulary(judge.data).members}
    judge.choices, point = len(members), np.array([[0.03]])
    names = "command_delay", "observation_delay"
    return judge.fitter.fit(Start(Hypothesis((members[n],)), point) for n in names), members


def test_a_log_as_it_is_stays_a_finalist_beside_mended_ones(tmp_path: Path) -> None:
    """Those are scored by unknowns of their own, which may lift them all above it."""
    judge = Judge(arm.data_of(arm.make_log(LATE, seconds=4.0, noise=NOISE), tmp_path))
    (late, old), members = fit_delays(judge)
    lifted = replace(old, score=late.score + 1.0)
    shifts = [m for name, m in members.items() if name.startswith("log.row_shift")]
    others = [replace(lifted, hypothesis=Hypothesis((shift,))) for shift in shifts]
    assert len(others) > judge.settings.rivals
    tried = {fit.label: fit for fit in (judge.given, late, lifted, *others)}
    best, _ = judge._refit(lifted, tried)
    assert best.label == late.label


def test_what_was_tried_is_judged_by_unknowns_around_the_best(tmp_path: Path) -> None:
    """By those alone that a search which starts there would have."""
    data = arm.data_of(arm.make_log(LATE, FRICTION, noise=NOISE), tmp_path)
    judge = Judge(data)
    (late, old), _ = fit_delays(judge)
    tried = {fit.label: fit for fit in (judge.given, late, old)}
    own, local, common = judge._make(late.hypothesis, late.values)
    others = [
        own.judge(fit.hypothesis, fit.values, (fit.own, fit.held)) for fit in (judge.given, old)
    ]
    best = judge._renew(late, tried)  # which alone takes over what fits the other half better
    for fit in others:
        np.testing.assert_allclose(tried[fit.label].score, fit.score, rtol=1e-9)
    assert best is tried[late.label]
    search, chosen = judge.search, judge.search.glance.chosen
    assert search.quick.likelihood is judge.fitter.likelihood is not own.likelihood
    (seen,) = search.glance.fit([Start(best.hypothesis, best.values[None])], rounds=0)
    rows = own.replayer.times[chosen], own.replayer.used[chosen], own.replayer.noise
    direct = Likelihood(*rows, local[chosen], common[chosen], judge.settings)
    search.glance.likelihood = direct
    (same,) = search.glance.fit([Start(best.hypothesis, best.values[None])], rounds=0)
    np.testing.assert_allclose(seen.score, same.score, rtol=1e-9)
    before = judge.fitter
    judge._refit(best, tried)
    assert judge.fitter is before  # whose unknowns are those around the best already


def test_an_explanation_that_is_right_but_for_a_member_is_pruned(tmp_path: Path) -> None:
    """Though a shorter one, which predicts worse, is ahead of it by its price."""
    judge = Judge(arm.data_of(arm.make_log(FRICTION, seconds=4.0, noise=NOISE), tmp_path))
    members = {m.label: m for m in Vocabulary(judge.data).members}
    judge.choices = len(members)
    true, other = members["coulomb_friction.b"], members["gravity_tilt"]
    (right,) = judge.fitter.fit([make_start(true)])
    (long,) = judge.fitter.fit([join_members(right, (other,), other.probes)])
    wrong = fit_of(judge, members["viscous_friction.b"], 0.0)
    wrong = replace(wrong, score=np.minimum(right.score, long.score) - 0.01)
    tried = {fit.label: fit for fit in (judge.given, wrong, long)}
    assert judge.choose(tried) is wrong and long.total > wrong.total
    assert judge._prune(tried, judge.fitter).label == true.label


def test_members_are_compared_with_what_is_like_them_until_none_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What replaces one has others that do about the same."""
    judge = Judge(arm.data_of(arm.make_log(FRICTION, seconds=4.0, noise=NOISE), tmp_path))
    members = {m.label: m for m in Vocabulary(judge.data).members}
    judge.choices = len(members)
    names = ("position_gain.b", "viscous_friction.b", "coulomb_friction.b")
    first, *better = [fit_of(judge, members[name], 1.0 + k) for k, name in enumerate(names)]
    tried, asked = {fit.label: fit for fit in (judge.given, first)}, list[str]()

    def swap(best: Fit, tried: dict[str, Fit]) -> None:
        asked.append(best.label)
        tried.update({fit.label: fit for fit in better[len(asked) - 1 :][:1]})

    monkeypatch.setattr(judge.search, "swap", swap)
    assert judge._swap(first, tried).label == names[-1]
    assert asked == list(names)
    assert judge._swap(judge.given, tried) is judge.given and len(asked) == len(names)


def test_before_the_search_ends_the_best_is_fitted_in_the_models_own_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though in longer ones no explanation is better than the model as given."""
    judge = Judge(arm.data_of(arm.make_log(FRICTION, seconds=4.0, noise=NOISE), tmp_path))
    own, asked = judge.search.quick.fit, []

    def fit(starts: Iterable[Start], rounds: int | None = None) -> list[Fit]:
        fits = own(starts, rounds)
        asked.extend(fit.label for fit in fits)
        return [replace(fit, score=np.minimum(fit.score, judge.given.score - 1.0)) for fit in fits]

    monkeypatch.setattr(judge.search.quick, "fit", fit)
    found = judge.judge(Vocabulary(judge.data, only=PROPOSED))
    assert found.best.label in asked
    assert (found.verdict, found.best.label) == ("explained", "coulomb_friction.b")


def test_a_mended_log_ahead_is_compared_with_the_log_as_it_is(tmp_path: Path) -> None:
    """Each by its own unknowns: those around the model as given would favour the mended one."""
    judge = Judge(arm.data_of(arm.make_log(LATE, noise=NOISE), tmp_path))
    (late, old), _ = fit_delays(judge)
    low = replace(late, score=late.score - 1.0)
    tried = {fit.label: fit for fit in (judge.given, low, old)}
    judge._judge_mended(tried | {old.label: replace(old, score=low.score - 1.0)})
    assert not judge._apart
    tried[old.label] = replace(old, score=low.score + 1.0)
    judge._judge_mended(tried)
    assert judge._apart == {late.label, old.label}
    assert tried[late.label].total > tried[old.label].total


def test_what_an_excluded_effect_does_as_well_is_not_explained(tmp_path: Path) -> None:
    """All motors weakened alike are a low voltage, and the voltage may not be named."""
    log = arm.make_log(("supply_voltage", {}, 0.8), seconds=12.0, noise=NOISE)
    data, only = arm.data_of(log, tmp_path), ["motor_strength (braking kept)"]
    free = Judge(data).judge(Vocabulary(data, only=only))
    assert free.verdict == "explained" and not free.imitators
    judgement = Judge(data).judge(Vocabulary(data, ["supply_voltage"], only=only))
    assert judgement.best.label == free.best.label
    assert judgement.verdict == "partly_explained"
    assert "supply_voltage predicts as well" in describe_remainder(judgement)
