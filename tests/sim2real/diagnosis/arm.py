"""A small arm and logs of it, made by simulation with known effects: truth for tests."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

from envs.effects import make
from envs.plant import Plant
from envs.replay import rollout
from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data

XML = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="upper"><joint name="a" axis="0 1 0" armature="0.01"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.3"/>
      <body name="lower" pos="0 0 -0.2"><joint name="b" axis="0 1 0" armature="0.01"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.2"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="a" joint="a" kp="8" damping="0.4" forcerange="-3 3"/>
    <position name="b" joint="b" kp="6" damping="0.3" forcerange="-3 3"/>
  </actuator>
</mujoco>
"""
RATE, STEP = 50.0, 0.002
JOINTS = ("a", "b")


def spec() -> mujoco.MjSpec:
    """Return the arm."""
    return mujoco.MjSpec.from_string(XML)


def make_log(
    *effects: tuple[str, dict, float], seconds: float = 8.0, seed: int = 0, noise: float = 0.0
) -> Log:
    """Return one episode of sweeps and steps of the arm, which has the effects."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * RATE)) / RATE
    phase = rng.uniform(0, 2 * np.pi, 2)
    sweep = 0.5 * np.sin(2 * np.pi * (0.3 * time + 0.15 * time**2)[:, None] + phase)
    steps = rng.uniform(-0.6, 0.6, (len(time) // 40 + 1, 2)).repeat(40, axis=0)[: len(time)]
    wanted = np.where((time % 4 < 2)[:, None], sweep, steps)
    made = [make(name, **arguments) for name, arguments, _ in effects]
    plant = Plant(spec(), made, 1, threads=1)
    every = np.zeros(1, int)
    plant.set_params(every, np.array([[value for *_, value in effects]]))
    start = np.zeros((1, 2))
    held = wanted[:1]
    plant.reset(every, start, start, np.zeros(1, np.uint64), held, measured=True)
    per = round(1 / RATE / STEP)
    path = rollout(plant, wanted.repeat(per, axis=0)[None])[0, :-1:per]
    path = path + noise * rng.normal(size=path.shape)
    columns = {"episode": np.zeros(len(time)), "time": time}
    columns |= {f"ctrl.{n}": wanted[:, i] for i, n in enumerate("ab")}
    columns |= {f"qpos.{n}": path[:, i] for i, n in enumerate("ab")}
    return Log(columns)


def replay_whole(plant: Plant, log: Log, read: Callable[[], np.ndarray]) -> np.ndarray:
    """Return what is read before each row of a log's commands, replayed from rest, (T, ...)."""
    ctrl, zero = np.column_stack([log.column(f"ctrl.{name}") for name in "ab"]), np.zeros((1, 2))
    plant.reset(np.zeros(1, int), zero, zero, np.zeros(1, np.uint64), ctrl[:1], measured=True)
    found = []
    for row in ctrl:
        found.append(read().copy())
        plant.step(None, row[None], round(1 / RATE / STEP))
    return np.array(found)


def model(folder: Path) -> str:
    """Write the arm's file; return its path."""
    path = folder / "arm.xml"
    path.write_text(XML, encoding="utf-8")
    return str(path)


def data_of(log: Log, folder: Path) -> Data:
    """Return a log's windows."""
    return Data.of([log], model(folder))
