"""The states of actuators when an episode begins."""

import mujoco
import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.data.states import state_of

ARM = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody>
  <body><joint name="a" axis="0 1 0" damping="0.5"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.4"/></body></worldbody>
  <actuator><intvelocity name="a" joint="a" kp="6" kv="0.2" gear="{gear}" actrange="-3 3"/>
  </actuator></mujoco>"""


@pytest.mark.parametrize("gear", [1.0, 2.5])
def test_an_integrator_that_holds_a_load_stands_ahead_of_its_joint(gear: float) -> None:
    """A robot that has settled goes on at rest from the state that its log implies."""
    model = mujoco.MjModel.from_xml_string(ARM.format(gear=gear))
    data = mujoco.MjData(model)
    data.act[:] = 0.4
    mujoco.mj_step(model, data, 10_000)
    seen = float(data.qpos[0])
    assert abs(gear * seen - 0.4) > 0.02
    columns = {"episode": [0, 0], "time": [0.0, 0.1], "ctrl.a": [0.0, 0.0], "qpos.a": [seen, seen]}
    state = state_of(Log({name: np.array(own) for name, own in columns.items()}), model)
    assert state == pytest.approx(0.4, abs=1e-6)
