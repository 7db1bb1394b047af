"""Mistakes of a log: each is undone by its own change, and by no more."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.inference.log_change import LogChange
from sim2real.diagnosis.inference.log_changes import find_reach, list_log_changes
from tests.sim2real.diagnosis import arm


@pytest.fixture(scope="module")
def log() -> Log:
    """Return a log of two episodes without any mistake."""
    first, second = arm.make_log(seconds=3.0), arm.make_log(seconds=3.0, seed=1)
    both = {n: np.concatenate([first.columns[n], second.columns[n]]) for n in first.columns}
    return Log({**both, "episode": np.repeat([0, 1], len(first))})


@pytest.fixture(scope="module")
def changes(log: Log, tmp_path_factory: pytest.TempPathFactory) -> dict[str, LogChange]:
    """Return all changes by their labels."""
    return {c.label: c for c in list_log_changes(arm.data_of(log, tmp_path_factory.mktemp("arm")))}


def broken(log: Log, **columns: np.ndarray) -> Log:
    """Return a log with other columns; `_` stands for the dot."""
    return Log({**log.columns, **{name.replace("_", "."): v for name, v in columns.items()}})


def test_labels_are_unique_and_probes_lie_within_bounds(changes: dict[str, LogChange]) -> None:
    """A label tells a change apart; what is looked at first is allowed; nothing is neutral."""
    assert len(changes) > 30
    for change in changes.values():
        assert change.probes.shape[1] == len(change.neutral) == len(change.low)
        assert (change.probes >= change.low).all()
        assert (change.probes <= change.high).all()
        assert not len(change.neutral) or (change.probes != change.neutral).any(axis=1).all()


def test_measured_speeds_tell_the_clock(
    log: Log, changes: dict[str, LogChange], tmp_path: Path
) -> None:
    """Where they are the change of positions over time it is right; else it alone is mended.

    One factor at all joints is the clock's; at one joint it may be a unit, and near 1 a filter.
    Without speeds the log shows nothing.
    """
    names = [f"qvel.{joint}" for joint in arm.JOINTS]
    slopes = [np.gradient(log.columns[f"qpos.{joint}"], log.time) for joint in arm.JOINTS]
    measured = Log({**log.columns, **dict(zip(names, slopes, strict=True))})
    wrong = Log({**measured.columns, "time": 1.25 * log.time})
    unit = broken(measured, qvel_a=1.2 * slopes[0], qvel_b=0.2 * slopes[1])
    filtered = broken(measured, qvel_a=0.9 * slopes[0], qvel_b=0.9 * slopes[1])
    right, other, apart, near = (
        {c.label: c for c in list_log_changes(arm.data_of(one, tmp_path))}
        for one in (measured, wrong, unit, filtered)
    )
    assert "log.clock.time" not in right
    clock = other["log.clock.time"]
    assert clock.shown
    for unclear in (apart, near, changes):
        assert not unclear["log.clock.time"].shown
    np.testing.assert_allclose(clock.probes, 1.25, rtol=0.01)
    assert clock.low > 1.15 and clock.high < 1.35
    mended = other["log.clock.time"].mended(wrong, np.array([1.25]))
    for name in ("time", *names):
        np.testing.assert_allclose(mended.columns[name], measured.columns[name], atol=1e-12)


@pytest.mark.parametrize(
    ("label", "values", "mistake"),
    [
        ("log.reversal.ctrl.qpos.b", [], {"qpos.b": -1.0, "ctrl.b": -1.0}),
        ("log.reversal.qpos.b", [], {"qpos.b": -1.0}),
        ("log.scale.ctrl.a", [0.25], {"ctrl.a": 0.25}),
        (
            "log.unit.ctrl.qpos",
            [],
            dict.fromkeys(["qpos.a", "qpos.b", "ctrl.a", "ctrl.b"], 180 / np.pi),
        ),
    ],
)
def test_a_factor_is_undone(
    log: Log,
    changes: dict[str, LogChange],
    label: str,
    values: list[float],
    mistake: dict[str, float],
) -> None:
    """Columns that were multiplied are what they were; the others are not touched."""
    wrong = Log({n: c * mistake.get(n, 1.0) for n, c in log.columns.items()})
    mended = changes[label].mended(wrong, np.array(values))
    for name, column in log.columns.items():
        np.testing.assert_allclose(mended.columns[name], column, atol=1e-12)


def test_rows_move_within_their_episode(log: Log, changes: dict[str, LogChange]) -> None:
    """A command column that stands a row late is moved up, and not across episodes."""
    late = log.columns["ctrl.a"].copy()
    for number in (0, 1):
        own = np.flatnonzero(log.episode == number)
        late[own[1:]] = log.columns["ctrl.a"][own[:-1]]
        late[own[0]] = log.columns["ctrl.a"][own[0]]
    mended = changes["log.row_shift.ctrl"].mended(broken(log, ctrl_a=late), np.array([1.0]))
    found = mended.columns["ctrl.a"]
    inside = np.append(np.diff(log.episode) == 0, False)
    np.testing.assert_array_equal(found[inside], log.columns["ctrl.a"][inside])


def test_late_readings_keep_their_values_and_get_their_own_stamps(
    log: Log, changes: dict[str, LogChange]
) -> None:
    """25 ms late at 20 ms a row: each goes one row back and was read 5 ms before that row."""
    mended = changes["observation_delay"].mended(log, np.array([0.025]))
    inside = np.append(np.diff(log.episode) == 0, False)
    np.testing.assert_array_equal(
        mended.columns["qpos.b"][inside], np.roll(log.columns["qpos.b"], -1)[inside]
    )
    off = mended.columns["stamp.b"] - log.time
    np.testing.assert_allclose(off[inside], -0.005, atol=1e-9)


@pytest.mark.parametrize(("rate", "rows"), [(20.0, 6), (50.0, 6), (200.0, 24)])
def test_readings_are_as_old_as_adapters_make_them_at_any_rate(
    log: Log, tmp_path: Path, rate: float, rows: int
) -> None:
    """An age is a time, not a number of rows; the effect can be as old as the readings."""
    other = broken(log, time=np.arange(len(log)) / rate)
    assert find_reach(other) == rows
    (late,) = [c for c in list_log_changes(arm.data_of(other, tmp_path)) if c.effect is not None]
    assert late.high == pytest.approx(rows / rate)
    assert late.effect is not None
    (age,) = late.effect.parameters(arm.spec().compile())
    assert age.high >= late.high


def test_a_turn_that_jumps_is_unwrapped(log: Log, tmp_path: Path) -> None:
    """The change is there only where a column jumps, and takes the jump out."""
    turned = log.columns["qpos.b"] + 2 * np.pi * (log.time > 1.5)
    wrong = broken(log, qpos_b=turned)
    changes = {c.label: c for c in list_log_changes(arm.data_of(wrong, tmp_path))}
    mended = changes["log.turn.qpos.b.jump"].mended(wrong, np.zeros(0))
    np.testing.assert_allclose(mended.columns["qpos.b"], log.columns["qpos.b"], atol=1e-12)
    assert changes["log.turn.qpos.b.jump"].value == 1.0
    assert changes["log.turn.qpos.b.jump"].seconds == (pytest.approx(1.52), log.time[-1])
    assert "log.turn.qpos.a.jump" not in changes


def test_increments_and_maps_of_commands(log: Log, changes: dict[str, LogChange]) -> None:
    """Policy outputs: scaled and without the default pose; or steps from command to command."""
    pose = np.array([0.3, -0.2])
    commands = np.column_stack([log.columns["ctrl.a"], log.columns["ctrl.b"]])
    small = 0.25 * (commands - pose)
    wrong = broken(log, ctrl_a=small[:, 0], ctrl_b=small[:, 1])
    mended = changes["log.scale.ctrl.posed"].mended(wrong, np.array([0.25, *pose]))
    np.testing.assert_allclose(mended.columns["ctrl.b"], commands[:, 1], atol=1e-12)
    steps = np.concatenate(
        [np.diff(part.columns["ctrl.a"], prepend=0.0) for part in log.episodes()]
    )
    summed = changes["log.increments.ctrl"].mended(broken(log, ctrl_a=steps), np.zeros(0))
    np.testing.assert_allclose(summed.columns["ctrl.a"], commands[:, 0], atol=1e-12)


def test_an_angle_from_the_ground_is_a_sum(log: Log, changes: dict[str, LogChange]) -> None:
    """A parallel linkage: the elbow's angle is that of two joints."""
    wrong = broken(
        log,
        qpos_b=log.columns["qpos.b"] + log.columns["qpos.a"],
        ctrl_b=log.columns["ctrl.b"] + log.columns["ctrl.a"],
    )
    mended = changes["log.column_map.ctrl.qpos.b.a"].mended(wrong, np.array([1.0]))
    np.testing.assert_allclose(mended.columns["qpos.b"], log.columns["qpos.b"], atol=1e-12)
    np.testing.assert_allclose(mended.columns["ctrl.b"], log.columns["ctrl.b"], atol=1e-12)


def test_counts_of_an_encoder_are_offered(log: Log, tmp_path: Path) -> None:
    """Whole numbers beyond a turn: the remedy is what columns.yaml takes, and it undoes them."""
    counts = {
        name: np.round(column * 4096 / (2 * np.pi)) + 2048
        for name, column in log.columns.items()
        if name.startswith(("qpos.", "ctrl."))
    }
    wrong = Log({**log.columns, **counts})
    data = arm.data_of(log, tmp_path)
    offered = {c.label: c for c in list_log_changes(replace(data, logs=(wrong,)))}
    change = offered["log.unit.ctrl.qpos.4096 from 2048"]
    assert "`unit: counts/4096` and `zero: 2048`" in change.mending(np.zeros(0))
    mended = change.mended(wrong, np.zeros(0))
    for name in counts:
        np.testing.assert_allclose(mended.columns[name], log.columns[name], atol=np.pi / 4096)
