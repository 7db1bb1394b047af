"""Rows in which something is in a joint's way."""

import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.recording import BLOCKED
from sim2real.diagnosis.data.windows import _usable
from sim2real.diagnosis.preflight.obstruction import mark_blocked, positioned
from tests.sim2real.diagnosis import arm, motors

RATE = 50.0
STOP = 0.6  # rad: where an obstacle is
DRIVEN = {"hinge": "hinge"}


def log_of(stop: float | None = None, current: bool = True, limit: float = np.inf) -> Log:
    """Return a log of a servo that follows rests at 1 rad and back, 4 s each, short by friction.

    Args:
        stop: an obstacle's place, or None.
        current: whether currents are logged.
        limit: of the current.
    """
    time = np.arange(0.0, 80.0, 1 / RATE)
    ctrl = np.where((time // 4) % 2 == 1, 1.0, 0.0)
    sink = 0.05 * np.sign(ctrl - 0.5)
    qpos = ctrl - sink
    if stop is not None:
        qpos = np.where(time > 70, np.minimum(qpos, stop), qpos)
    columns = {"time": time, "ctrl.hinge": ctrl, "qpos.hinge": qpos, "episode": np.zeros(len(time))}
    if current:
        columns["current.hinge"] = np.minimum(4.0 * np.abs(ctrl - qpos), limit)
    return Log(columns, {"robot": "bench1"}, None)


def test_a_joint_that_is_held_is_flagged() -> None:
    """Errors and currents far above those of other rests, and half a second around."""
    (marked,), (finding,) = mark_blocked([log_of(STOP)], DRIVEN)
    held = marked.columns[BLOCKED] > 0
    assert finding.check == "blocked" and finding.where == "hinge"
    assert "0.4 short of its goal" in finding.finding
    blocked = (marked.time > 70) & (marked.column("ctrl.hinge") > 0.5)
    assert held[blocked].all() and not held[marked.time < 67.3].any()
    assert (held & ~blocked).sum() / RATE < 2.1  # two rests at the obstacle, either side of each


def test_what_is_not_sure_is_left_alone() -> None:
    """No obstacle, no currents, or a motor that gives no more: a weak motor is no obstacle."""
    for log in (log_of(), log_of(STOP, current=False), log_of(STOP, limit=0.3)):
        (same,), findings = mark_blocked([log], DRIVEN)
        assert same is log and not findings


def test_a_free_horn_a_few_counts_off_is_not_held() -> None:
    """Its usual error is a count, and its usual current a digit: three of either are no sign."""
    log = log_of(current=False)
    count, ctrl = 2 * np.pi / 4096, log.column("ctrl.hinge")
    counts = np.where(log.time > 76, 3.0, 1.0)
    columns = {"qpos.hinge": ctrl - counts * count, "current.hinge": counts**2}
    horn = Log({**log.columns, **columns}, log.meta, None)
    (same,), findings = mark_blocked([horn], DRIVEN)
    assert same is horn and not findings


def test_flagged_rows_are_not_compared() -> None:
    """Those that the log flags itself are kept out, too."""
    log = log_of()
    flag = (log.time > 10) & (log.time < 12)
    own = Log({**log.columns, BLOCKED: flag.astype(float)}, log.meta, None)
    (marked,), _ = mark_blocked([own], DRIVEN)
    assert (marked.columns[BLOCKED] == flag).all()
    assert (_usable(marked, 0, len(marked)) == ~flag).all()


def renamed(log: Log, **names: str) -> Log:
    """Return the log with other names of some columns; double underscores stand for dots."""
    new = {old.replace("__", "."): name for old, name in names.items()}
    return Log({new.get(n, n): c for n, c in log.columns.items()}, log.meta, None)


def test_an_actuator_of_another_name_than_its_joint_is_seen() -> None:
    """Which joint an actuator drives is the model's word, not a matter of names."""
    log = renamed(log_of(STOP), ctrl__hinge="ctrl.motor", current__hinge="sensor.current_raw_motor")
    (marked,), (finding,) = mark_blocked([log], {"motor": "hinge"})
    assert finding.where == "hinge" and marked.columns[BLOCKED].any()


def test_a_torque_is_no_goal() -> None:
    """Only servos, and motors whose rows bring gains, can stand short of one."""
    log = motors.make_log(0.0, 2.0)
    assert positioned(log, motors.spec()) == {}
    assert positioned(log, arm.spec()) == {"a": "a", "b": "b"}
    assert positioned(Log({**log.columns, "kp.a": np.ones(len(log))}), motors.spec()) == {"a": "a"}


def test_the_current_of_another_joint_is_not_taken() -> None:
    """`hip` has no current of its own where only that of `left_hip` is logged."""
    names = {"ctrl__hinge": "ctrl.hip", "qpos__hinge": "qpos.hip"}
    log = renamed(log_of(STOP), **names, current__hinge="current.left_hip")
    (same,), findings = mark_blocked([log], {"hip": "hip"})
    assert same is log and not findings
