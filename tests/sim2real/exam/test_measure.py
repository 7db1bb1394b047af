"""The exam's own measure: positions are compared at the moment when they were read."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.plant import Plant
from envs.replay import Recording, replay, switchable
from hardware.log import Log
from sim2real.exam.measure import apart, with_moments


def swing(rows: int = 60) -> Recording:
    """Return a motion of bench1."""
    time = np.arange(rows) * 0.02
    ctrl = np.sin(3 * time)[:, None]
    return Recording(time, ctrl, np.zeros(1), np.zeros(1), np.ones((rows, 1), bool))


def test_a_log_of_the_simulation_itself_has_no_gap() -> None:
    """Neither read at the rows' times nor, said by its stamps, 5 ms before."""
    spec = mujoco.MjSpec.from_file("envs/assets/bench1.xml")
    plain = swing()
    read = np.maximum(plain.time - 0.005, 0)
    dense = with_moments(plain, read)
    path = replay(Plant(switchable(spec)), [dense])[0][:, 0]
    columns = {"episode": np.zeros(60), "time": plain.time, "ctrl.hinge": plain.ctrl[:, 0]}
    for stamp in (plain.time, read):
        qpos = path[np.searchsorted(dense.time, stamp)]
        log = Log({**columns, "qpos.hinge": qpos, "stamp.hinge": stamp})
        assert apart(log, spec) == pytest.approx(0, abs=1e-9)
    late = Log({**columns, "qpos.hinge": path[np.searchsorted(dense.time, read)]})
    assert apart(late, spec)[0] > 5e-3


def test_more_moments_change_no_command(tmp_path: Path) -> None:
    """A command holds until the next row's, and servos that are off stay off."""
    plain = swing()
    plain.powered[20:40] = False  # type: ignore[index]
    dense = with_moments(plain, np.array([0.011, 0.405, 0.79]))
    rows = np.searchsorted(dense.time, plain.time)
    assert np.array_equal(dense.ctrl[rows], plain.ctrl)
    assert dense.ctrl[np.searchsorted(dense.time, 0.405)] == plain.ctrl[20]
    assert not dense.powered[np.searchsorted(dense.time, 0.79)]  # type: ignore[index]
