"""The verb diagnose on logs of the emulated bench, whose hidden effect it is never told."""

import json
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from envs.effects import EFFECTS, load_effects, make, write_effects
from hardware.config import load_robot
from hardware.connect import make_driver
from hardware.emulator.hidden import make_hidden
from hardware.emulator.world import EmulatedRobot
from hardware.errors import LogError
from hardware.excite import excite
from hardware.log import Log, write_log
from hardware.record import record
from hardware.safety import Guard, StopLimits
from sim2real.diagnosis.data.recording import load_model
from sim2real.diagnosis.data.replay import measure, summary
from sim2real.diagnosis.diagnose import diagnose, run_diagnosis
from sim2real.diagnosis.inference.log_changes import find_reach
from sim2real.diagnosis.outcome import Diagnosis, write
from sim2real.diagnosis.report.text import quantity
from sim2real.diagnosis.schema import Report, WholeReplay
from sim2real.runs.errors import Sim2RealError
from sim2real.verbs import diagnose as command

MOTIONS = ("ramp", "chirp", "steps", "swing")
FRICTIONS = [name for name in EFFECTS if name.endswith("_friction") or name == "backlash"]


def subsets(count: int) -> list[tuple[int, ...]]:
    """Return the subsets of so many causes that are not empty."""
    return [some for size in range(1, count + 1) for some in combinations(range(count), size)]


SHARES: list[float] = []  # of the work done, as the last diagnosis told them


def make_log(*hidden: dict[str, Any], seed: int = 0, seconds: float = 6.0) -> Log:
    """Return a log of the emulated bench."""
    robot = load_robot("bench1")
    driver = make_driver(robot, EmulatedRobot(robot, make_hidden(list(hidden), robot), seed=seed))
    try:
        driver.connect()
        driver.configure()
        with Guard(driver, StopLimits(odd_voltage=1.0, stray=2.0)) as guard:
            pose = np.clip(guard.arm().position, guard.low, guard.high)
            plan = excite(robot, pose, seconds, MOTIONS, np.random.default_rng(seed))
            return record(guard, plan)
    finally:
        driver.close()


@cache
def found(*excluded: str) -> Diagnosis:
    """Diagnose a log that hides friction."""
    log = make_log({"effect": "coulomb_friction", "where": "hinge", "value": 0.02})
    SHARES.clear()
    return run_diagnosis([log], None, None, excluded, 0, lambda text, share: SHARES.append(share))


def test_a_hidden_effect_is_named_with_its_value() -> None:
    """Friction that the nominal model lacks is the first cause, and adding it closes the gap."""
    report = found().report
    assert report.verdict == "explained"
    cause = report.causes[0]
    assert (cause.effect, cause.where, cause.form) == ("coulomb_friction", "hinge", "holds")
    assert cause.value_ci[0] <= 0.02 <= cause.value_ci[1]
    assert cause.value == pytest.approx(0.02, rel=0.1)
    assert report.gap.closed is not None and report.gap.closed > 0.85
    assert report.gap.after is not None and report.gap.after < 0.0023  # rad
    assert report.gap.held_out
    assert sorted(SHARES) == SHARES
    assert SHARES[-1] == 1.0
    assert report.where[0].joint == "hinge"
    assert sum(c.closed for c in report.causes) == pytest.approx(report.gap.closed, abs=0.02)


def test_the_evidence_shows_what_the_report_says() -> None:
    """Traces, ladder, candidates and bands belong to the same before and after."""
    report = found().report
    evidence = report.evidence
    assert evidence.ladder[0].gap == pytest.approx(report.gap.before)
    assert evidence.ladder[-2].gap == pytest.approx(report.gap.after, rel=1e-6)
    assert evidence.singles[0].effect == "coulomb_friction"
    trace = evidence.traces[0]
    errors = [np.nanstd(path - trace.measured) for path in (trace.nominal, trace.corrected)]
    assert errors[1] < 0.3 * errors[0]
    pieces = [path - trace.measured for path in (trace.nominal, trace.corrected)]
    squares = [float(np.sqrt(np.nanmean(piece**2))) for piece in pieces]
    assert squares == pytest.approx([report.gap.before, report.gap.after], rel=1e-6)
    log = make_log({"effect": "coulomb_friction", "where": "hinge", "value": 0.02})
    assert trace.starts[0] == find_reach(log) and len(trace.starts) > 1
    assert np.isnan(trace.nominal[: trace.starts[0]]).all()  # what a shift may leave unknown
    assert set(trace.subsets) == {frozenset(), *map(frozenset, subsets(len(report.causes)))}
    assert {signal.kind for signal in evidence.signals} == {"command", "current", "voltage"}
    before, after = (
        np.sqrt(sum(getattr(band, side) ** 2 for band in evidence.bands))
        for side in ("before", "after")
    )
    assert after < 0.5 * before


def test_nothing_hidden_is_no_gap() -> None:
    """A model that is right is told so, with no cause and nothing closed."""
    report = diagnose([make_log(seed=3, seconds=4.0)])
    assert report.verdict == "no_gap"
    assert report.causes == ()
    assert report.gap.after is None and report.gap.closed is None


@pytest.mark.slow
def test_what_is_excluded_is_not_named() -> None:
    """With the true effect withheld no other one takes all its place for certain."""
    report = found(*FRICTIONS).report
    assert "coulomb_friction" not in [cause.effect for cause in report.causes]
    assert report.verdict not in ("no_gap", "explained")
    assert report.where[0].joint == "hinge"
    assert report.gap.closed is not None and report.gap.closed < 0.9


def test_the_run_writes_its_files(tmp_path: Path) -> None:
    """report.json, report.html, effects.yaml and model.xml; the effects load and are the causes."""
    diagnosis = found()
    write(diagnosis, tmp_path)
    tree = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert Report.from_json(tree).causes[0].effect == "coulomb_friction"
    effects = load_effects(tmp_path / "effects.yaml")
    assert [effect.name for effect, _ in effects] == [c.effect for c in diagnosis.report.causes]
    assert "frictionloss" in (tmp_path / "model.xml").read_text(encoding="utf-8")
    assert (tmp_path / "report.html").stat().st_size > 10_000


def test_the_report_says_what_the_verb_replay_says(tmp_path: Path) -> None:
    """run=replay of the same log, without and with effects.yaml, gives the same figures."""
    diagnosis = found()
    write(diagnosis, tmp_path)
    log = make_log({"effect": "coulomb_friction", "where": "hinge", "value": 0.02})
    causes = load_effects(tmp_path / "effects.yaml")
    without, known = (
        summary([measure(log, load_model(log, None), fixed)])["rmse"] for fixed in ([], causes)
    )
    assert diagnosis.report.replay == WholeReplay(without, known)
    assert known < 0.5 * without
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"gives {quantity(without, 'rad')} with the model as given" in page
    assert f"{quantity(known, 'rad')} with effects.yaml" in page


@pytest.mark.slow
def test_a_known_effect_leaves_no_gap(tmp_path: Path) -> None:
    """What a diagnosis found, put into the model, is not found again."""
    diagnosis = found()
    write(diagnosis, tmp_path)
    log = make_log({"effect": "coulomb_friction", "where": "hinge", "value": 0.02})
    assert diagnose([log], effects=tmp_path / "effects.yaml").verdict == "no_gap"


def test_the_file_holds_what_was_known_too(tmp_path: Path) -> None:
    """A known effect stays in effects.yaml; one that more was found of is there once, with both."""
    diagnosis = found()
    ((_, (value,)), (low, high)) = diagnosis.found[0], diagnosis.intervals[0]
    friction, rotor = make("coulomb_friction", where="hinge"), make("armature", where="hinge")
    known = ((rotor, (1e-4,)), (friction, (0.005,)))
    write(diagnosis._replace(known=known), tmp_path)
    entries = yaml.safe_load((tmp_path / "effects.yaml").read_text(encoding="utf-8"))
    assert [entry["effect"] for entry in entries[:2]] == ["armature", "coulomb_friction"]
    assert (entries[0]["value"], entries[0]["ci"]) == (1e-4, None)
    assert entries[1]["value"] == pytest.approx(value + 0.005)
    assert entries[1]["ci"] == pytest.approx([low + 0.005, high + 0.005])
    assert len(entries) == 1 + len(diagnosis.found)


@pytest.mark.slow
def test_more_of_a_known_effect_is_found(tmp_path: Path) -> None:
    """A gain known to be 0.8 that is 0.5 is found to be 0.63 of that, and the file says 0.5."""
    write_effects(tmp_path / "known.yaml", [(make("position_gain", where="hinge"), (0.8,))])
    log = make_log({"effect": "position_gain", "where": "hinge", "value": 0.5})
    found = run_diagnosis([log], None, tmp_path / "known.yaml", (), 0, None)
    (cause,) = [c for c in found.report.causes if c.effect == "position_gain"]
    assert cause.value == pytest.approx(0.5 / 0.8, rel=0.05)
    write(found, tmp_path)
    ((gain, values),) = [
        e for e in load_effects(tmp_path / "effects.yaml") if e[0].name == cause.effect
    ]
    assert (gain.where, values[0]) == ("hinge", pytest.approx(0.5, rel=0.05))


def test_mistakes_are_said_before_any_file(tmp_path: Path) -> None:
    """No log, no model, an unknown effect, joints at rest: one sentence, and nothing written."""
    given: dict[str, Any] = {"model": None, "effects": None, "exclude": [], "seed": 0}
    given |= {"against": None, "actor": None}
    out = tmp_path / "out"
    with pytest.raises(Sim2RealError, match="log=PATH"):
        command.run(log=None, out=out, **given)
    with pytest.raises(LogError, match="no such log"):
        command.run(log=str(tmp_path / "none.csv"), out=out, **given)
    log = make_log(seconds=4.0)
    path = write_log(tmp_path / "still.csv", Log({**log.columns, "qpos.hinge": 0 * log.time}))
    with pytest.raises(Sim2RealError, match="names no model"):
        command.run(log=str(path), out=out, **given)
    given["model"] = str(load_robot("bench1").model)
    with pytest.raises(Sim2RealError, match=r"hinge never moved"):
        command.run(log=str(path), out=out, **given)
    given["exclude"] = ["backlsh"]
    with pytest.raises(Sim2RealError, match="did you mean 'backlash'"):
        command.run(log=str(path), out=out, **given)
    assert not out.exists()


def test_a_model_that_cannot_follow_says_when(tmp_path: Path) -> None:
    """A gain that no time step carries is named with log, episode and moment."""
    text = load_robot("bench1").model.read_text(encoding="utf-8")
    broken = tmp_path / "broken.xml"
    broken.write_text(text.replace('kp="1.3067"', 'kp="1e7"').replace("forcerange", "user"))
    with pytest.raises(Sim2RealError, match=r"episode 0: the model cannot follow.* diverges at"):
        diagnose([make_log(seconds=4.0)], broken)
