"""An investigation goes on while motions can part what is left, and says why it ends."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.effects import make
from hardware.config import load_robot
from hardware.log import Log, read_log
from sim2real.deployment.record import record_motions
from sim2real.diagnosis.experiments.apart import Member
from sim2real.diagnosis.experiments.menu import Item
from sim2real.diagnosis.outcome import Diagnosis
from sim2real.diagnosis.schema import Cause, Equivalent, GapMetrics, Report, Unexplained
from sim2real.loops.investigate import SearchBudget, investigate
from sim2real.runs.errors import Sim2RealError

FIRST = Item("slow ramps", ("ramp",), 4.0, 0.3)
GAP = GapMetrics("rad", 0.02, 0.001, 0.0005, 0.99, (0.9, 1.0), True)
CAUSE = Cause("viscous_friction", "hinge", None, 0.03, (0.02, 0.04), "", {}, 0.9, 0.99)
REPORT = Report("explained", GAP, (), (CAUSE,), Unexplained(0.01, "none"))
ANSWER = Diagnosis(REPORT, (), mujoco.MjSpec(), (), ())


def recorder(hidden: Path) -> Callable[[Item, Path], Log]:
    """Return what drives the bench, with something hidden in it, along motions."""
    robot = replace(load_robot("bench1"), hidden=hidden)

    def record(item: Item, path: Path) -> Log:
        record_motions(
            robot, item.motions, item.seconds, np.random.default_rng(item.seed), path, item.size
        )
        return read_log(path)

    return record


def hide(folder: Path, text: str) -> Path:
    """Write an effects file."""
    path = folder / "hidden.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_budget_below_one_recording_is_refused(tmp_path: Path) -> None:
    """Nothing moves, and nothing is written."""

    def never(item: Item, path: Path) -> Log:
        raise AssertionError("it moved")

    with pytest.raises(Sim2RealError, match=r"budget=3 s is below one recording of 4 s"):
        investigate(load_robot("bench1"), never, SearchBudget(3.0), FIRST, seed=0, out=tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_it_records_what_parts_two_laws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two laws of friction are open after slow ramps; a faster motion is recorded, and ends it."""
    pair = tuple(
        Member(name, ((make(name, where="hinge"), (value,)),))
        for name, value in (("viscous_friction", 0.03), ("coulomb_friction", 0.02))
    )
    asked: list[int] = []

    def diagnosed(logs: list[Log], *_: object, on_verdict: object) -> Diagnosis:
        asked.append(len(logs))
        left = pair if len(logs) == 1 else ()
        return ANSWER._replace(equivalents=left, floors={"hinge": 5e-4})

    monkeypatch.setattr("sim2real.loops.investigate.run_diagnosis", diagnosed)
    monkeypatch.setattr("sim2real.loops.investigate.write", lambda *_: None)
    limits = SearchBudget(20.0, draws=4, exact=1)
    record = recorder(hide(tmp_path, "- {effect: viscous_friction, where: hinge, value: 0.03}\n"))
    found = investigate(load_robot("bench1"), record, limits, FIRST, seed=0, out=tmp_path)
    assert asked == [1, 2]
    assert found.end == "one_left"
    first, second = found.rounds
    assert first.promised is None and first.left == ("viscous_friction", "coulomb_friction")
    assert second.promised is not None and second.promised > 3
    assert second.motions != ("ramp",)
    assert found.seconds == first.seconds + second.seconds <= 20
    log = read_log(tmp_path / "recordings" / "01.csv")
    assert len(log) == round(50 * second.seconds)


@pytest.mark.slow
def test_two_that_are_one_do_not_end_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A third explanation can still be parted from both; then nothing is left to part."""
    three = (
        Member("encoder_offset", ((make("encoder_offset", where="hinge"), (0.05,)),)),
        Member("gravity_tilt", ((make("gravity_tilt"), (0.0, 0.05)),)),
        Member("viscous_friction", ((make("viscous_friction", where="hinge"), (0.03,)),)),
    )
    monkeypatch.setattr(
        "sim2real.loops.investigate.run_diagnosis",
        lambda logs, *_, **__: ANSWER._replace(
            equivalents=three if len(logs) == 1 else three[:2], floors={"hinge": 5e-4}
        ),
    )
    monkeypatch.setattr("sim2real.loops.investigate.write", lambda *_: None)
    limits = SearchBudget(30.0, draws=4, exact=1)
    record = recorder(hide(tmp_path, "- {effect: encoder_offset, where: hinge, value: 0.05}\n"))
    found = investigate(load_robot("bench1"), record, limits, FIRST, seed=0, out=tmp_path)
    assert found.end == "not_parted"
    assert [len(one.left) for one in found.rounds] == [3, 2]
    promised = found.rounds[1].promised
    assert promised is not None and promised > 3
    assert found.apart is not None and found.apart < 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "other", "end"),
    [
        ("encoder_offset", Equivalent("offset", "hinge", True, "log"), "log_or_robot"),
        ("push", Equivalent("torque_limit", "hinge"), "push_or_robot"),
    ],
)
def test_what_no_motion_can_part_is_not_the_one_that_is_left(
    effect: str, other: Equivalent, end: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Readings off by a constant look like a shifted encoder; one moment may be a push, or not."""
    cause = replace(CAUSE, effect=effect, equivalent=(other,))
    answer = ANSWER._replace(report=replace(REPORT, causes=(cause,)))
    monkeypatch.setattr("sim2real.loops.investigate.run_diagnosis", lambda *_, **__: answer)
    monkeypatch.setattr("sim2real.loops.investigate.write", lambda *_: None)
    record = recorder(hide(tmp_path, "- {effect: viscous_friction, where: hinge, value: 0.03}\n"))
    limits = SearchBudget(7.0)
    found = investigate(load_robot("bench1"), record, limits, FIRST, seed=0, out=tmp_path)
    assert found.end == end and found.seconds == 4.0


@pytest.mark.slow
def test_a_spent_budget_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where less than a motion's time is left, what is open stays open, by name."""
    pair = tuple(
        Member(name, ((make(name, where="hinge"), (value,)),))
        for name, value in (("viscous_friction", 0.03), ("coulomb_friction", 0.02))
    )
    monkeypatch.setattr(
        "sim2real.loops.investigate.run_diagnosis",
        lambda *_, **__: ANSWER._replace(equivalents=pair, floors={"hinge": 5e-4}),
    )
    monkeypatch.setattr("sim2real.loops.investigate.write", lambda *_: None)
    record = recorder(hide(tmp_path, "- {effect: viscous_friction, where: hinge, value: 0.03}\n"))
    found = investigate(
        load_robot("bench1"), record, SearchBudget(7.0), FIRST, seed=0, out=tmp_path
    )
    assert found.end == "budget"
    assert found.seconds == 4.0
    assert found.rounds[-1].left == ("viscous_friction", "coulomb_friction")


@pytest.mark.slow
def test_what_no_motion_can_part_is_said(tmp_path: Path) -> None:
    """A shifted encoder and a tilted base are one to a pendulum: it stops after one recording.

    A third of the shift would not do: gravity changes by no more than the usual error of a model.
    """
    hidden = hide(tmp_path, "- {effect: encoder_offset, where: hinge, value: 0.15}\n")
    first = Item("steps", ("steps",), 6.0)
    limits = SearchBudget(20.0, draws=8, exact=1)
    out = tmp_path / "out"
    found = investigate(load_robot("bench1"), recorder(hidden), limits, first, seed=0, out=out)
    assert found.end == "not_parted"
    assert found.seconds == 6.0
    assert found.apart is not None and found.apart < 3
    assert {"encoder_offset.hinge", "gravity_tilt"} <= set(found.rounds[0].left)
    told = json.loads((out / "investigate.json").read_text(encoding="utf-8"))
    assert told["end"] == "not_parted"
    assert told["rounds"][0]["left"] == list(found.rounds[0].left)
    for name in ("report.json", "report.html", "effects.yaml", "investigate.md"):
        assert (out / name).is_file()
    assert len(list((out / "recordings").glob("*.csv"))) == 1
