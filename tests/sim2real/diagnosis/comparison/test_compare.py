"""Has a simulated arm changed? Its truth is known."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log, write_log
from sim2real.diagnosis.comparison.answer import Comparison
from sim2real.diagnosis.comparison.compare import compare, compare_fleet
from sim2real.diagnosis.comparison.guard import GuardError, read_guard
from sim2real.diagnosis.comparison.page import bars, write_page
from sim2real.runs.errors import Sim2RealError
from tests.sim2real.diagnosis import arm
from tests.sim2real.diagnosis.contract.test_page import shown

FRICTION = ("coulomb_friction", {"where": "a"})
WATCH = ["coulomb_friction", "payload", "position_gain", "gravity_tilt"]
NOISE = 1e-3  # rad


@cache
def driven(more: float = 0.0, motion: int = 3, seconds: float = 12.0) -> Log:
    """The arm with friction of its own at one joint, or some more of it."""
    return arm.make_log((*FRICTION, 0.1 + more), seconds=seconds, seed=motion)


def noisy(log: Log, seed: int, **channels: float) -> Log:
    """Return a log with the noise of a session, and what its sensors say all the time."""
    rng = np.random.default_rng(seed)
    columns = {
        name: values + NOISE * rng.normal(size=len(log)) * name.startswith("qpos")
        for name, values in log.columns.items()
    }
    for kind, value in {"temperature": 30.0, **channels}.items():
        columns |= {f"{kind}.{joint}": np.full(len(log), value) for joint in arm.JOINTS}
    return Log(columns, log.meta)


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> str:
    """The arm's file."""
    return arm.model(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="module")
def changed(model) -> Comparison:
    """What is said of 20 % more friction, along the same motion."""
    known = {"temperature": 30.0, "voltage": 12.0}
    sides = noisy(driven(), 1, **known), noisy(driven(0.02), 2, **known)
    return compare(*sides, model, watch=WATCH)


def test_the_change_is_named_with_its_value(changed: Comparison) -> None:
    """Effect, joint, value and interval; what both have; differences of one motion."""
    assert (changed.verdict, changed.exit_status) == ("changed", 3)
    (first,) = changed.changes
    assert (first.effect, first.where) == ("coulomb_friction", "a")
    alike = [(one.effect, one.where) for one in first.alike]
    assert alike in ([], [("coulomb_friction", None)])  # only this joint has friction
    assert first.change == pytest.approx(0.02, rel=0.15)
    assert first.interval[0] < first.change < first.interval[1]
    assert first.p <= 0.01
    assert changed.shared[0].value == pytest.approx(0.1, rel=0.05)
    assert changed.numbers["same_motions"] is True
    assert [c.text for c in changed.confounders][:2] == [
        "close enough: next to nothing is put down to it",
        "the same supply",
    ]


def test_nothing_is_said_of_a_robot_that_is_the_same(model) -> None:
    """Noise alone; what could have been seen stands in the intervals."""
    answer = compare(noisy(driven(), 1), noisy(driven(), 2), model, watch=WATCH)
    assert (answer.verdict, answer.exit_status, answer.changes) == ("unchanged", 0, ())
    own = next(c for c in answer.watched if (c.effect, c.where) == ("coulomb_friction", "a"))
    assert own.interval[0] < 0 < own.interval[1]
    assert own.interval[1] - own.interval[0] < 0.02


@pytest.mark.slow
def test_a_servo_that_measures_at_other_ticks_has_not_changed(model) -> None:
    """One joint is read 2 ms earlier in its motion than it was the other day."""
    after = noisy(driven(), 2)
    time = after.column("time")
    late = {"qpos.a": np.interp(time - 2e-3, time, after.column("qpos.a"))}
    later = Log({**after.columns, **late}, after.meta)
    assert compare(noisy(driven(), 1), later, model, watch=WATCH).verdict == "unchanged"


@pytest.mark.slow
def test_other_motions_are_compared_too(model) -> None:
    """Nothing cancels then, and more is needed; sides are exchanged."""
    first, second = noisy(driven(), 1), noisy(driven(0.05, motion=4), 2)
    answer = compare(first, second, model, watch=["coulomb_friction"])
    assert answer.numbers["same_motions"] is False
    assert (answer.changes[0].effect, answer.changes[0].where) == ("coulomb_friction", "a")
    assert answer.changes[0].change == pytest.approx(0.05, rel=0.3)


@pytest.mark.slow
def test_what_all_joints_share_is_put_down_to_temperature(model) -> None:
    """20 % more friction in all joints is a change at the same temperature, and none at another."""
    known = {"temperature": 30.0, "voltage": 12.0}
    effects = [("coulomb_friction", {"where": None})]
    before, after = (
        arm.make_log((*effects[0], value), seconds=12.0, seed=3) for value in (0.08, 0.1)
    )
    warm = compare(noisy(before, 1, **known), noisy(after, 2, **known), model, watch=WATCH)
    assert warm.changes[0].effect == "coulomb_friction"
    colder = noisy(after, 2, **{**known, "temperature": 10.0})
    assert compare(noisy(before, 1, **known), colder, model, watch=WATCH).verdict == "unchanged"


@pytest.mark.slow
def test_a_supply_that_was_measured_needs_no_statistics(model) -> None:
    """A tenth less voltage is a change, told by its sensor; within its limit it passes."""
    sides = noisy(driven(), 1, voltage=12.0), noisy(driven(), 2, voltage=10.8)
    (change,) = compare(*sides, model, watch=WATCH).changes
    assert (change.effect, change.source) == ("supply_voltage", "measured")
    assert change.change == pytest.approx(-0.1)
    passed = compare(*sides, model, watch=WATCH, limits={"supply_voltage": 0.2})
    assert passed.changes == ()
    assert passed.tolerated[0].effect == "supply_voltage"


def test_a_supply_alone_may_be_watched(model) -> None:
    """Its sensor says what changed, and nothing is left to test."""
    sides = noisy(driven(), 1, voltage=12.0), noisy(driven(), 2, voltage=10.8)
    answer = compare(*sides, model, watch=["supply_voltage"])
    assert [change.source for change in answer.changes] == ["measured"]
    assert [change.effect for change in answer.watched] == ["supply_voltage"]


@pytest.mark.slow
def test_limits_let_changes_pass_or_ask_for_more(model, changed: Comparison) -> None:
    """A change within its limit is tolerated; a limit below the resolution cannot be judged."""
    known = {"temperature": 30.0, "voltage": 12.0}
    sides = noisy(driven(), 1, **known), noisy(driven(0.02), 2, **known)
    answer = compare(*sides, model, watch=WATCH, limits={"coulomb_friction": 0.03})
    assert (answer.verdict, len(answer.tolerated)) == ("unchanged", 1)
    same = noisy(driven(), 1, **known), noisy(driven(), 2, **known)
    fine = compare(*same, model, watch=WATCH, limits={"coulomb_friction": 1e-4})
    assert (fine.verdict, fine.exit_status) == ("cannot_tell", 4)
    assert "coulomb_friction" in fine.reason and "longer" in fine.reason


def test_too_little_is_said_to_be_too_little(model) -> None:
    """A few seconds are no eight independent pieces."""
    short = driven(seconds=4.0)
    answer = compare(noisy(short, 1), noisy(short, 2), model, watch=["coulomb_friction"])
    assert answer.verdict == "cannot_tell"
    assert "too few" in answer.reason


def at_rest(seed: int, *joints: str) -> Log:
    """Return the arm's log as if some joints had stayed where they hang."""
    still = {f"{kind}.{joint}": np.zeros(600) for kind in ("ctrl", "qpos") for joint in joints}
    return noisy(Log({**driven().columns, **still}), seed)


def test_a_robot_that_stays_shows_nothing(model) -> None:
    """A load that is known to several kg at links of 0.3 kg is no load that did not change."""
    sides = at_rest(1, "a", "b"), at_rest(2, "a", "b")
    answer = compare(*sides, model, watch=["payload"])
    assert (answer.verdict, answer.exit_status) == ("cannot_tell", 4)
    assert "move more" in answer.reason
    assert [label for label, _ in answer.untold] == ["payload.upper", "payload.lower"]
    assert all(" kg" in why for _, why in answer.untold)


def test_a_joint_that_stays_hides_its_own_changes_alone(model, tmp_path: Path) -> None:
    """The others are as they were; what could not be seen is counted and listed."""
    sides = at_rest(1, "b"), at_rest(2, "b")
    answer = compare(*sides, model, watch=["viscous_friction"])
    assert (answer.verdict, answer.exit_status) == ("unchanged", 0)
    assert "2 of 3 changes cannot be seen" in answer.reason
    assert [label for label, _ in answer.untold] == ["viscous_friction", "viscous_friction.b"]
    page = write_page(answer, tmp_path / "compare.html").read_text()
    assert "viscous friction at all joints alike" in page


def test_what_may_all_be_temperature_cannot_be_told(model) -> None:
    """Where nothing that was watched is left, the answer says what would help."""
    sides = noisy(driven(), 1), noisy(driven(), 2)
    answer = compare(*sides, model, watch=["gravity_tilt"])
    assert answer.exit_status == 4
    assert "remounted=false" in answer.reason


def test_of_a_fleet_the_odd_one_is_found(model, tmp_path: Path) -> None:
    """Three arms of which one has more friction; the page says which."""
    logs = {
        name: noisy(driven(more), k, temperature=30.0) for k, (name, more) in enumerate(ODD.items())
    }
    fleet = compare_fleet(logs, model, watch=["coulomb_friction"])
    assert fleet.exit_status == 3
    assert {name: one.verdict for name, one in fleet.units.items()}["c"] == "changed"
    (change,) = fleet.units["c"].changes
    assert (change.where, change.change) == ("a", pytest.approx(0.03, rel=0.25))
    assert fleet.mean[0].effect == "coulomb_friction"
    fleet.write(tmp_path / "compare.json")
    assert set(json.loads((tmp_path / "compare.json").read_text())["units"]) == set(ODD)
    assert "c: not like the others." in write_page(fleet, tmp_path / "compare.html").read_text()


ODD = {"a": 0.0, "b": 0.0, "c": 0.03}


def test_the_page_in_a_browser(browser: str, changed: Comparison, tmp_path: Path) -> None:
    """The verdict, the change and its interval are drawn; nothing is fetched."""
    page = write_page(changed, tmp_path / "compare.html")
    text, complaints = shown(browser, page)
    assert complaints == ""
    assert "Changed: 1 effect." in text
    assert "Coulomb friction at a" in text
    assert text.count("<svg") == len(bars(changed))
    sure = {bar.change.where for bar in bars(changed) if bar.sure}
    assert "a" in sure <= {"a", None}  # only this joint has friction: all joints look the same


def test_what_cannot_be_compared_is_refused(model, tmp_path: Path) -> None:
    """Two robots, wrong names, wrong limits: a sentence each."""
    other = tmp_path / "other.xml"
    other.write_text(arm.XML)
    one, two = (Log(driven().columns, {"model": str(path)}) for path in (model, other))
    with pytest.raises(Sim2RealError, match="two models cannot be compared"):
        compare(one, two)
    names = {f"qpos.{n}": driven().column("qpos.a") for n in "xy"}
    rest = {n: v for n, v in driven().columns.items() if not n.startswith("qpos")}
    with pytest.raises(Sim2RealError, match="different robots"):
        compare(driven(), Log({**rest, **names}), model)
    with pytest.raises(Sim2RealError, match=r"watch: 'friction'.*coulomb_friction"):
        compare(driven(), driven(), model, watch=["friction"])
    with pytest.raises(Sim2RealError, match=r"limits\.backlash=-1 must be"):
        compare(driven(), driven(), model, limits={"backlash": -1})
    with pytest.raises(Sim2RealError, match="expected at least 3 robots"):
        compare_fleet({"a": driven(), "b": driven()}, model)
    with pytest.raises(Sim2RealError, match="after: no logs"):
        compare(driven(), [], model)


def test_a_guards_file_says_what_to_compare_with(tmp_path: Path) -> None:
    """Paths are relative to the file."""
    write_log(tmp_path / "golden.csv", driven())
    path = tmp_path / "robot_ci.yaml"
    path.write_text("recording: golden.csv\nremounted: false\nlimits: {backlash: 0.01}\n")
    assert read_guard(path) == {
        "before": str(tmp_path / "golden.csv"),
        "remounted": False,
        "limits": {"backlash": 0.01},
    }


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[1]", "mapping"),
        ("recordings: a", "recording"),
        ("limits: {}", "recording is missing"),
        ("recording: nowhere", "no such file"),
        ("recording: robot_ci.yaml\nremounted: 3", "true or false"),
        ("recording: robot_ci.yaml\nwatch: backlash", "list of effects"),
        ("recording: [", "cannot be read"),
    ],
)
def test_a_wrong_guards_file_is_refused(tmp_path: Path, text: str, words: str) -> None:
    """With the file and what is allowed."""
    path = tmp_path / "robot_ci.yaml"
    path.write_text(text)
    with pytest.raises(GuardError, match=words) as refused:
        read_guard(path)
    assert str(path) in str(refused.value)
