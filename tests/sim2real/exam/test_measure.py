"""The exam's own measure: positions are compared at the moment when they were read."""

import mujoco
import numpy as np
import pytest

from envs.plant import Plant
from envs.replay import Recording, replay, switchable
from hardware.log import Log
from sim2real.exam.measure import apart


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
    columns = {"episode": np.zeros(60), "time": plain.time, "ctrl.hinge": plain.ctrl[:, 0]}
    for stamp in (plain.time, read):
        qpos = replay(Plant(switchable(spec)), [plain._replace(read=stamp[:, None])])[0][:, 0]
        log = Log({**columns, "qpos.hinge": qpos, "stamp.hinge": stamp})
        assert apart(log, spec) == pytest.approx(0, abs=1e-9)
    late = Log({**columns, "qpos.hinge": qpos})
    assert apart(late, spec)[0] > 5e-3
