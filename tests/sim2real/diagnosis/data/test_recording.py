"""Rows of a log as recordings: where a replay starts, and what it is told."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.data.recording import rows_before, rows_of, to_recording
from tests.sim2real.diagnosis import arm

ROW = 57  # of a start in mid-motion


@pytest.fixture(scope="module")
def log() -> Log:
    """Four seconds of the arm."""
    return arm.make_log(seconds=4.0)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    """The arm."""
    return arm.spec().compile()


def test_the_clock_starts_with_the_first_row(log: Log, model: mujoco.MjModel) -> None:
    """A log whose time counts from another moment is the same recording."""
    later = Log({**log.columns, "time": log.time + 12.0, "stamp.a": log.time + 11.995})
    one, other = to_recording(log, model), to_recording(later, model)
    np.testing.assert_allclose(other.time, one.time, atol=1e-12)
    assert other.read is not None
    np.testing.assert_allclose(other.read, np.column_stack([one.time - 0.005, one.time]))
    assert np.array_equal(other.qpos, one.qpos)


def test_the_command_before_a_start_is_held(log: Log, model: mujoco.MjModel) -> None:
    """In mid-episode it is the row's before, at an episode's start the first one."""
    ctrl = np.column_stack([log.column(f"ctrl.{name}") for name in "ab"])
    part = rows_of(log, ROW, ROW + 50)
    inside = to_recording(part, model, rows_before(log, ROW))
    assert rows_before(log, 0) is None
    assert inside.held == pytest.approx(ctrl[ROW - 1])
    assert to_recording(part, model).held == pytest.approx(ctrl[ROW])


def test_a_start_in_mid_episode_has_the_slope_of_the_positions(
    log: Log, model: mujoco.MjModel
) -> None:
    """Where no speeds are logged; at the start of an episode the robot rests."""
    part = rows_of(log, ROW, ROW + 50)
    found = to_recording(part, model, rows_before(log, ROW)).qvel
    around = np.column_stack([log.column(f"qpos.{name}")[ROW - 1 : ROW + 2] for name in "ab"])
    assert found == pytest.approx((around[2] - around[0]) * arm.RATE / 2, abs=0.05)
    assert np.abs(found).min() > 0.1
    assert not to_recording(part, model).qvel.any()

def test_a_start_has_the_speeds_that_were_logged(log: Log, model: mujoco.MjModel) -> None:
    """Anywhere in an episode."""
    speeds = {f"qvel.{name}": np.linspace(0, k, len(log)) for k, name in ((1.0, "a"), (-2.0, "b"))}
    told = Log({**log.columns, **speeds})
    for row in (0, ROW):
        part = rows_of(told, row, row + 50)
        found = to_recording(part, model, rows_before(told, row)).qvel
        assert found.tolist() == [column[row] for column in speeds.values()]
