"""A servo's loop that hunts: seen in a log, kept out of windows, and told of a model too."""

from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.noise_floor import noise_floor
from sim2real.diagnosis.data.recording import HUNTING, is_flagged
from sim2real.diagnosis.data.replay import measure_all
from sim2real.diagnosis.data.trial import choose
from sim2real.diagnosis.diagnose import diagnose
from sim2real.diagnosis.preflight.hunting import hunting, mark_hunting, tell_simulated
from tests.sim2real.diagnosis import arm

TIME = np.arange(0.0, 10.0, 0.01)
STEP = np.where(TIME < 4.0, 0.0, 1.0)
SINCE = np.clip(TIME - 4.0, 0.0, None)
DRIVEN = {"a": "a", "b": "b"}
OWN = 'kp="6" damping="0.3" forcerange="-3 3"'
STIFF = 'kp="12" kv="0.4" forcerange="-3 3"'
SOFT = ("hysteretic_compliance", {"where": "b", "side": "link", "friction": 0.1}, 0.06)


def swinging(decay: float, until: float = 8.0, hertz: float = 6.0) -> np.ndarray:
    """Return an angle that follows a step and swings about it by 0.1 rad, which dies away [1/s]."""
    swing = 0.1 * np.exp(-decay * SINCE) * np.sin(2 * np.pi * hertz * SINCE)
    return STEP + swing * (until > TIME)


def test_steady_swings_are_hunting_and_measured() -> None:
    """When, how far from side to side, and how fast."""
    (hunt,) = hunting(TIME, swinging(0.0), STEP)
    assert hunt.first == pytest.approx(4.04, abs=0.03) and hunt.last == pytest.approx(8.0, abs=0.1)
    assert hunt.swing == pytest.approx(0.2, rel=0.02)
    assert hunt.frequency == pytest.approx(6.0, rel=0.02)


def test_what_dies_away_or_was_asked_for_is_none() -> None:
    """Ringing, a command that swings itself, noise, and tops that are level."""
    noise = np.random.default_rng(0).normal(size=len(TIME))
    assert not hunting(TIME, swinging(3.0), STEP)
    assert not hunting(TIME, swinging(0.0), swinging(0.0, hertz=6.0))
    assert not hunting(TIME, STEP + 5e-4 * noise, STEP)
    assert not hunting(TIME, STEP + 1.5e-3 * (noise > 1), STEP)


def test_a_joint_that_others_shake_does_not_hunt() -> None:
    """What swings as another joint is told to, such as an ankle in a gait, is asked for."""
    gait = np.sin(2 * np.pi * 6.0 * TIME)
    assert not hunting(TIME, swinging(0.0), STEP, [gait])
    assert hunting(TIME, swinging(0.0), STEP, [np.sin(2 * np.pi * 0.5 * TIME)])


def test_its_first_swing_is_kept() -> None:
    """Half a period after the first turn the rows are flagged, to a moment after the last one."""
    columns = {"time": TIME, "episode": 0 * TIME, "ctrl.a": STEP, "qpos.a": swinging(0.0)}
    (marked,), (finding,) = mark_hunting([Log(columns)], {"a": "a"})
    out = TIME[marked.columns[HUNTING] > 0]
    assert 4.04 + 1 / 12 - 0.02 < out[0] < 4.04 + 1 / 12 + 0.04
    assert 8.0 < out[-1] < 8.3 and len(out) == round((out[-1] - out[0]) / 0.01) + 1
    assert finding.where == "a" and "0.2 from side to side at 6 Hz" in finding.finding
    still = Log({**columns, "qpos.a": STEP})
    (same,), nothing = mark_hunting([still], {"a": "a"})
    assert same is still and not nothing


def test_a_joint_whose_servo_is_off_swings_freely() -> None:
    """A pendulum that was let go does not hunt, however long it swings."""
    columns = {"time": TIME, "episode": 0 * TIME, "ctrl.a": STEP, "qpos.a": swinging(0.0)}
    free = Log({**columns, "torque.a": (TIME < 5.0).astype(float)})
    (same,), findings = mark_hunting([free], {"a": "a"})
    assert same is free and not findings
    _, findings = mark_hunting([Log({**columns, "torque.a": 1.0 + 0 * TIME})], {"a": "a"})
    assert findings


@pytest.fixture(name="stiff")
def _stiff(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give the arm's second servo a gain at which a spring in its loop makes it hunt."""
    assert OWN in arm.XML
    monkeypatch.setattr(arm, "XML", arm.XML.replace(OWN, STIFF))
    monkeypatch.setattr(arm, "RATE", 100.0)


def test_windows_end_where_it_begins_and_start_at_rest(stiff: None, tmp_path: Path) -> None:
    """No compared row is in it, nor within 0.8 s after it."""
    log = arm.make_log(SOFT, seconds=16.0, noise=1e-4)
    (marked,), _ = mark_hunting([log], DRIVEN)
    hunts = marked.columns[HUNTING] > 0
    assert 0.1 < hunts.mean() < 0.8
    data = Data.of([marked], arm.model(tmp_path))
    for window in data.windows:
        before = np.searchsorted(log.time, log.time[window.start] - 0.79)
        assert not hunts[before : window.last].any()


def test_a_model_is_told_to_hunt_or_not(stiff: None) -> None:
    """As given it does not; with the spring it does, as fast and as far as the log."""
    log = arm.make_log(SOFT, seconds=16.0, noise=1e-4)
    (marked,), findings = mark_hunting([log], DRIVEN)
    (gap,) = measure_all([marked], [arm.spec()])
    one = next(f for f in findings if f.where == "b")
    same = gap._replace(simulated=gap.measured)
    (told,), _ = tell_simulated([one], DRIVEN, [("As given", [gap]), ("with all", [same])])
    assert (
        "As given, the simulator does not hunt; with all, the simulator hunts for" in told.finding
    )
    first, last = told.finding.split("with all")
    size = first.split(" s, ")[1].split(",")[0]
    assert size in last


def test_pieces_that_are_replayed_on_trial_do_not_hunt(stiff: None) -> None:
    """Else a log whose loop hunts looks as if its clock ran ten times too fast."""
    log = arm.make_log(SOFT, seconds=24.0, noise=1e-4)
    (marked,), _ = mark_hunting([log], DRIVEN)
    calm = choose([marked], 2.0)
    assert calm and not any(is_flagged(one.log, HUNTING)[one.rows].any() for one in calm)
    assert len(choose([marked], 24.0)) == 1  # where there is no other piece


@pytest.mark.slow
def test_a_spring_that_makes_its_servo_hunt_is_named(stiff: None, tmp_path: Path) -> None:
    """From the first swings; where the hunting was compared as well, nothing was found."""
    log = arm.make_log(SOFT, seconds=24.0, noise=1e-4)
    report = diagnose(log, arm.model(tmp_path))
    first = report.causes[0]
    assert (first.effect, first.where, first.side) == ("hysteretic_compliance", "b", "link")
    assert first.value == pytest.approx(0.06, rel=0.1)
    told = " ".join(f.finding for f in report.preflight)
    assert "with the causes, the simulator hunts" in told


def test_a_model_that_does_not_hunt_explains_nothing(stiff: None) -> None:
    """However near it is where rows are compared; it was `no_gap` where hunting was noise."""
    log = arm.make_log(SOFT, seconds=16.0, noise=1e-4)
    (marked,), findings = mark_hunting([log], DRIVEN)
    (gap,) = measure_all([marked], [arm.spec()])
    as_given, same = ("", [gap]), ("", [gap._replace(simulated=gap.measured)])
    assert tell_simulated(findings, DRIVEN, [same, as_given])[1]
    assert not tell_simulated(findings, DRIVEN, [as_given, same])[1]
    assert tell_simulated([], DRIVEN, [as_given]) == ([], False)
    assert tell_simulated(findings, DRIVEN, []) == (findings, False)  # no model can be replayed
    floors = noise_floor([marked])
    assert max(floors.values()) < 1e-3 < noise_floor([log])["b"]
