"""A weight on a rod that a voltage-driven motor swings, and logs of it, made by simulation."""

from pathlib import Path

import mujoco
import numpy as np

from envs.effects import make
from envs.plant import Plant
from envs.replay import rollout
from hardware.log import Log

XML = """
<mujoco>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="rod"><joint name="pivot" axis="0 1 0" armature="0.012" damping="0.01"
        frictionloss="0.05"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.006" mass="0.08"/>
      <geom size="0.03" pos="0 0 -0.25" mass="0.45"/>
    </body>
  </worldbody>
  <actuator>
    <general name="pivot" joint="pivot" biastype="affine" gainprm="16" biasprm="0 -16"
        damping="0.3" forcerange="-3 3"/>
  </actuator>
</mujoco>
"""
RATE, STEP = 100.0, 0.001


def model(folder: Path) -> str:
    """Write the pendulum's file; return its path."""
    path = folder / "pendulum.xml"
    path.write_text(XML, encoding="utf-8")
    return str(path)


def make_log(*effects: tuple[str, dict, float], seconds: float = 12.0) -> Log:
    """Return one episode of wide swings from 0.3 to 2.5 Hz of the pendulum, with the effects."""
    time = np.arange(round(seconds * RATE)) / RATE
    wanted = 1.4 * np.sin(2 * np.pi * (0.3 * time + 0.09 * time**2))[:, None]
    plant = Plant(mujoco.MjSpec.from_string(XML), [make(n, **a) for n, a, _ in effects], 1, 1)
    every = np.zeros(1, int)
    plant.set_params(every, np.array([[value for *_, value in effects]]))
    start = np.zeros((1, 1))
    plant.reset(every, start, start, np.zeros(1, np.uint64), wanted[:1], measured=True)
    per = round(1 / RATE / STEP)
    path = rollout(plant, wanted.repeat(per, axis=0)[None])[0, :-1:per]
    columns = {"episode": np.zeros(len(time)), "time": time}
    return Log({**columns, "ctrl.pivot": wanted[:, 0], "qpos.pivot": path[:, 0]})
