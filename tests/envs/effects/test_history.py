"""What reaches an actuator through its delay line, against the force that the engine applies."""

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.effects.history import DelayedCommands
from envs.effects.places import block
from envs.plant import Plant

ARM = """<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody>
    <body><joint name="a" axis="0 1 0" armature="0.01"/>
      <inertial pos="0.1 0 0" mass="0.2" diaginertia="1e-4 1e-4 1e-4"/>
      <body pos="0.2 0 0"><joint name="b" axis="0 1 0" armature="0.01"/>
        <inertial pos="0.1 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/></body></body>
  </worldbody><actuator>
    <position name="a" joint="a" kp="4" ctrlrange="-0.5 0.5"/>
    <position name="b" joint="b" kp="3" delay="0.0035" nsample="8" interp="linear"/>
  </actuator></mujoco>"""


def test_what_is_read_is_what_the_engine_acts_on() -> None:
    """In every substep, for whole and broken delays, none, a model's own and clamped commands."""
    rows, rng = 4, np.random.default_rng(0)
    effects = [make("dead_zone", where="a"), make("command_delay", longest=0.02)]
    plant = Plant(mujoco.MjSpec.from_string(ARM), effects, rows, 1)
    plant.set_params(np.arange(rows), np.array([[1e-12, d] for d in (0.0, 0.002, 0.0047, 0.02)]))
    every, force = np.arange(rows), plant.batch.bind("actuator_force")
    start = np.full((rows, 2), 0.3)
    plant.reset(every, start * 0, start * 0, np.zeros(rows, np.uint64), ctrl=start)
    arrivals, both, told, done = DelayedCommands.of(plant), np.arange(2), [], []
    for step in range(60):
        q = plant.qpos.copy()
        plant.step(None, rng.uniform(-1.0, 1.0, (rows, 2)) if step % 7 == 0 else plant.ctrl, 1)
        told.append(arrivals.at((slice(None), both)).copy())  # of the substep that was taken
        done.append(force / (4.0, 3.0) + q)
        assert np.array_equal(arrivals.at(block(every[1:3], both[1:])), told[-1][1:3, 1:])
    assert np.ptp(told, axis=0).min() > 0.5  # something arrived everywhere
    assert np.array(told) == pytest.approx(np.array(done), abs=1e-9)
