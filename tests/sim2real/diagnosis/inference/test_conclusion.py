"""From a judgement to a report: causes of each kind, values with intervals, what is left."""

from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.inference.baseline import Baseline
from sim2real.diagnosis.inference.conclusion import Conclusion, make_conclusion
from sim2real.diagnosis.inference.judge import Judge
from sim2real.diagnosis.inference.vocabulary import Vocabulary
from sim2real.diagnosis.schema import Report
from tests.sim2real.diagnosis import arm

NOISE, FRICTION = 3e-4, 0.12


def concluded(log: Log, folder: Path, *labels: str) -> Conclusion:
    """Return the conclusion on a log, changes of these labels alone being looked at."""
    data, rng = arm.data_of(log, folder), np.random.default_rng(0)
    judge = Judge(data, rng=rng)
    baseline = Baseline.of(judge.replayer, rng)
    return make_conclusion(judge.judge(Vocabulary(data, only=labels)), baseline, rng)


@pytest.fixture(scope="module")
def friction(tmp_path_factory: pytest.TempPathFactory) -> Conclusion:
    """Return what is concluded of dry friction in one joint, beside friction of another law."""
    log = arm.make_log(("coulomb_friction", {"where": "b"}, FRICTION), noise=NOISE)
    folder = tmp_path_factory.mktemp("arm")
    return concluded(log, folder, "coulomb_friction.b", "viscous_friction.b")


def test_an_effect_becomes_a_cause_with_its_value(friction: Conclusion) -> None:
    """One value, inside a narrow interval, that closes the gap; what programs take has it too."""
    report = friction.report
    (cause,) = report.causes
    assert report.verdict == "explained"
    assert (cause.kind, cause.effect, cause.where) == ("robot", "coulomb_friction", "b")
    assert cause.value == pytest.approx(FRICTION, rel=0.03)
    assert cause.value_ci[0] < cause.value < cause.value_ci[1]
    assert 0.1 * FRICTION < np.ptp(cause.value_ci) < 0.2 * FRICTION, "no robot keeps to its law"
    assert cause.confidence > 0.9
    assert cause.closed > 0.9
    assert [effect.label() for effect, _ in friction.found] == ["coulomb_friction.b"]
    assert report.unexplained.structure == "none"


def test_errors_behind_a_report_are_those_of_all_rows(friction: Conclusion) -> None:
    """With the cause and without any, so that pictures can be drawn."""
    before, after = (friction.errors[frozenset(places)] for places in ((), (0,)))
    assert before.shape == after.shape
    assert np.square(after).sum() < 0.05 * np.square(before).sum()
    assert [rung.label for rung in friction.ladder][-1] == "noise floor"


def test_a_report_of_any_kind_survives_its_file(tmp_path: Path) -> None:
    """A mistake of the log is a cause with a remedy, and no effect of the robot."""
    log = arm.make_log(noise=NOISE)
    turned = {n: -log.columns[n] for n in ("ctrl.b", "qpos.b")}
    wrong = Log({**log.columns, **turned})
    made = concluded(wrong, tmp_path, "log.reversal.ctrl.qpos.b", "viscous_friction.b")
    (cause,) = made.report.causes
    assert (cause.kind, cause.effect, cause.where) == ("log", "reversal", "b")
    assert cause.remedy == "ctrl.b, qpos.b: multiply by -1"
    assert cause.extra["columns"] == ["ctrl", "qpos"]
    assert made.found == ()
    assert Report.from_json(made.report.to_json()).causes[0].kind == "log"


def test_readings_that_are_off_for_a_moment_are_to_be_left_out(tmp_path: Path) -> None:
    """They are a mistake of the log, with its joint and moment; nothing is written as an effect."""
    log = arm.make_log(noise=NOISE)
    off = np.where((log.time >= 5.0) & (log.time <= 5.2), 0.1, 0.0)
    made = concluded(Log({**log.columns, "qpos.a": log.columns["qpos.a"] + off}), tmp_path)
    assert made.report.verdict == "partly_explained"
    (cause,) = made.report.causes
    assert (cause.kind, cause.effect, cause.where, cause.equivalent) == ("log", "glitch", "a", ())
    assert (cause.value, cause.unit) == (pytest.approx(0.1, rel=0.1), "rad")
    assert cause.seconds == pytest.approx((5.0, 5.2), abs=0.05)
    start, end = (f"{moment:.2f}" for moment in cause.seconds or ())
    assert cause.remedy == f"qpos.a: leave out {start} to {end} s of episode 0"
    assert made.found == ()


def test_what_is_left_is_told_with_its_joint_and_its_time(tmp_path: Path) -> None:
    """A reading that jumps for some hundredths of a second, as no law and no push moves a joint."""
    log = arm.make_log(noise=NOISE)
    bump = 0.1 * np.exp(-(((log.time - 5.1) / 0.02) ** 2))
    made = concluded(Log({**log.columns, "qpos.a": log.columns["qpos.a"] + bump}), tmp_path)
    assert made.report.verdict == "unexplained"
    assert made.report.causes == ()
    text = made.report.unexplained.structure
    assert "at a" in text
    assert "of episode 0" in text
    start = float(text.split(" at ")[-1].split(" to ")[0])
    assert start == pytest.approx(5.0, abs=0.15)


@pytest.mark.slow
def test_what_makes_one_model_is_inseparable(tmp_path: Path) -> None:
    """A supply is a factor on every motor's voltage, as their strength is that keeps braking."""
    log = arm.make_log(("supply_voltage", {}, 0.8), seconds=12.0, noise=NOISE)
    made = concluded(log, tmp_path, "motor_strength (braking kept)", "supply_voltage")
    (cause,) = made.report.causes
    assert cause.value == pytest.approx(0.8, rel=0.02)
    names = {cause.effect, *(other.effect for other in cause.equivalent)}
    assert names == {"motor_strength", "supply_voltage"}
    assert all(other.inseparable for other in cause.equivalent)
