"""Windows begin where the state of the robot is known."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator

THROWN = """
<mujoco><option timestep="0.001"/>
<worldbody><body pos="0 0 1"><freejoint name="root"/><geom type="box" size=".1 .06 .04" mass="1"/>
<body pos="0.1 0 0"><joint name="leg" axis="0 1 0" armature="0.001" damping="0.01"/>
<geom type="capsule" fromto="0 0 0 0 0 -.1" size=".01" mass="0.1"/></body></body></worldbody>
<actuator><motor name="leg" joint="leg" ctrlrange="-1 1"/></actuator></mujoco>
"""


def worst(log: Log, model: Path) -> tuple[float, int]:
    """Return the first window's error with the true model [rad or m], and the row it starts at."""
    data = Data.of([log], model)
    every = np.arange(len(data.windows))
    error = Simulator(data, threads=1).run((), every, np.zeros((len(every), 0))).error
    return float(np.abs(error[0] * data.scale).max()), data.windows[0].start


@pytest.mark.parametrize("moving", [False, True])
def test_a_thrown_base_flies_on(moving: bool, tmp_path: Path) -> None:
    """Two metres a second at the first row, without logged speeds, are seen in the next rows."""
    path = tmp_path / "thrown.xml"
    path.write_text(THROWN)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    if moving:
        data.qvel[:6] = 2.0, -0.5, 4.0, 0.5, 1.0, -0.3
    rows, states = 240, np.zeros((240, model.nq))
    ctrl = 0.02 * np.sin(0.06 * np.arange(rows))
    for row in range(rows):
        states[row], data.ctrl[0] = data.qpos, ctrl[row]
        mujoco.mj_step(model, data, 5)
    columns = {"episode": np.zeros(rows), "time": 0.005 * np.arange(rows), "ctrl.leg": ctrl}
    columns |= {f"qpos.root.{k}": states[:, k] for k in range(7)} | {"qpos.leg": states[:, 7]}
    error, start = worst(Log(columns), path)
    assert start == 2
    assert error < 0.02
