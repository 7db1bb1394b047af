"""What is left of a diagnosis when a later step fails, a cause is numerics, or the log is wrong."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.effects import EFFECTS, load_effects, make
from hardware.log import Log, read_logs
from sim2real.diagnosis import additions
from sim2real.diagnosis.diagnose import run_diagnosis
from sim2real.diagnosis.outcome import Diagnosis, final_message, write
from sim2real.diagnosis.prepare import PreparedLogs
from sim2real.diagnosis.report.text import details
from sim2real.diagnosis.schema import Cause, Finding, GapMetrics, Report, Unexplained
from sim2real.diagnosis.settings import DEFAULT
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis import arm


def cause(effect: str) -> Cause:
    """Return a cause at joint a."""
    return Cause(effect, "a", None, 0.1, (0.05, 0.15), "N·m", {}, 0.9, 0.5)


@pytest.fixture
def found() -> Diagnosis:
    """A diagnosis of two causes."""
    names = ("coulomb_friction", "viscous_friction")
    gap = GapMetrics("rad", 0.1, 0.01, 0.002, 0.9, (0.8, 0.95), True)
    report = Report("explained", gap, (), tuple(map(cause, names)), Unexplained(0.1, "none"))
    effects = tuple((make(name, where="a"), (0.1,)) for name in names)
    return Diagnosis(report, effects, arm.spec(), ((0.05, 0.15), (0.05, 0.15)), ())


def test_the_verdict_is_written_before_what_may_fail(tmp_path: Path, monkeypatch) -> None:
    """A picture that cannot be drawn costs a line, not the report."""

    def fail(*_: object) -> None:
        raise ValueError("size 1 must be positive in geom")

    monkeypatch.setattr(additions, "traces", fail)
    (tmp_path / "arm.xml").write_text(arm.XML)
    early: list[Diagnosis] = []
    log, others = arm.make_log(seconds=4.0), sorted({*EFFECTS} - {"coulomb_friction"})
    made = run_diagnosis(
        [log], tmp_path / "arm.xml", None, others, 0, None, on_verdict=early.append
    ).report
    assert [one.report.verdict for one in early] == [made.verdict] == ["no_gap"]
    assert made.failed == ("the pictures of recordings: size 1 must be positive in geom",)
    assert any("size 1" in words for words in final_message(made))


def test_a_cause_that_is_numerics_is_told_and_not_written(tmp_path, found, monkeypatch) -> None:
    """`effects.yaml` is about the robot: what a finer simulation mends is not in it."""
    said = {"coulomb_friction": "this is the simulator's numerics", "viscous_friction": None}
    monkeypatch.setattr(additions, "is_numerics", lambda logs, specs, one, *_: said[one[0][0].name])
    data = arm.data_of(arm.make_log(seconds=4.0), tmp_path)
    prepared = PreparedLogs([], data, [], {}, [], None)
    tested = additions.tested(found, prepared, DEFAULT)
    write(tested, tmp_path)
    names = [effect.name for effect, _ in load_effects(tmp_path / "effects.yaml")]
    assert names == ["viscous_friction"]
    assert tested.report.numerics["coulomb_friction at a"] == said["coulomb_friction"]
    assert [one.effect for one in tested.report.causes] == list(said)


@pytest.mark.parametrize(("check", "files"), [("range", 2), ("rate", 2), ("gaps", 4)])
def test_a_log_that_contradicts_itself_makes_no_effects(tmp_path, found, check, files) -> None:
    """The report is there and its last words say why nothing else is, also no earlier ones."""
    write(found, tmp_path)
    assert len(list(tmp_path.iterdir())) == 4
    finding = Finding(check, "a", "It looks wrong.", "Mend it.")
    report = replace(found.report, preflight=(finding,))
    write(found._replace(report=report), tmp_path)
    assert len(list(tmp_path.iterdir())) == files
    assert (tmp_path / "report.html").is_file()
    words = final_message(report)
    assert "What is left is 5.0 times the noise floor" in words[0]
    assert "It looks wrong. Mend it." in words
    assert words[-1].startswith("effects.yaml and model.xml are not written") == (files == 2)


def test_two_causes_at_one_joint_are_doubted(found: Diagnosis) -> None:
    """They can imitate a missing law; one, or two at several joints or at all, cannot."""
    cause = replace(found.report.causes[0], where="a", shared=False)
    crowd = [replace(cause, effect=name) for name in ("armature", "cogging")]
    told = final_message(replace(found.report, causes=tuple(crowd)))
    assert any(words.startswith("2 effects are named at a. Together") for words in told)
    elsewhere = (crowd[0], replace(crowd[1], where="b"))
    wide = tuple(replace(one, where=None, shared=True) for one in crowd)
    for causes in (tuple(crowd[:1]), elsewhere, wide):
        told = final_message(replace(found.report, causes=causes))
        assert not any("effects are named at" in words for words in told)


def test_a_model_of_boxes_can_carry_a_load() -> None:
    """The ball of the next experiment is a ball, whatever the model's geoms are by default."""
    from sim2real.diagnosis.experiments.menu import menu

    text = arm.XML.replace(
        "<worldbody>", '<default><geom type="box" size="1 1 1"/></default><worldbody>'
    )
    spec = mujoco.MjSpec.from_string(text)
    (item,) = [item for item in menu(spec) if item.by_hand and " g to the end" in item.by_hand]
    assert item.change is not None
    before = spec.copy().compile().body_mass.sum()
    item.change(spec)
    assert spec.compile().body_mass.sum() > before


def test_a_log_in_memory_is_diagnosed_like_a_list_of_one() -> None:
    """`diagnose(log, model)` reads nothing from disk and takes the log as it is."""
    log = arm.make_log(seconds=1.0)
    assert read_logs(log) == [log] == read_logs([log])


@pytest.mark.slow
def test_degrees_are_a_cause_of_the_log(tmp_path: Path) -> None:
    """Commands and positions alike in degrees: said, with the remedy, and no effect is blamed."""
    (tmp_path / "arm.xml").write_text(arm.XML)
    log = arm.make_log(seconds=8.0)
    angles = [name for name in log.columns if name.startswith(("ctrl.", "qpos."))]
    turned = {name: np.rad2deg(log.columns[name]) for name in angles}
    degrees = Log({**log.columns, **turned}, log.meta)
    found = run_diagnosis([degrees], tmp_path / "arm.xml", None, (), 0, None)
    (cause,) = found.report.causes
    assert (cause.kind, cause.effect) == ("log", "unit")
    assert any("pi / 180" in words for words in final_message(found.report))
    assert found.found == ()
    assert {trace.unit for trace in found.report.evidence.traces} == {"log units"}
    assert "log units as given" in details(found.report) and "rad" not in details(found.report)


def test_no_logs_are_nothing_to_diagnose() -> None:
    """A folder whose logs were all thrown away says so."""
    with pytest.raises(Sim2RealError, match="no logs to diagnose"):
        run_diagnosis([], None, None, (), 0, None)
