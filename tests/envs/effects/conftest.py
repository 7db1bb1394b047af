from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import pytest

from envs.effects import EFFECTS, Effect, make
from envs.plant import Plant

STEP = 0.001  # s
SERVO = '<position name="servo" joint="hinge" kp="4" kv="0.1" ctrlrange="-3 3" forcerange="-2 2"/>'
MOTOR = '<motor name="servo" joint="hinge" forcerange="-2 2"/>'
ARM = """
<mujoco>
  <option timestep="0.001" integrator="implicitfast" gravity="0 0 {gravity}"/>
  <worldbody>
    <body name="link">
      <joint name="hinge" axis="0 1 0" armature="{armature}" damping="{damping}"/>
      <inertial pos="0.1 0 0" mass="0.2" diaginertia="1e-4 1e-4 1e-4"/>
      <site name="tip" pos="0.2 0 0"/>
    </body>
  </worldbody>
  <actuator>{actuator}</actuator>
  <keyframe><key name="home" qpos="0.3" ctrl="0.3"/></keyframe>
</mujoco>
"""
MASS, CENTER, INERTIA = 0.2, 0.1, 1e-4 + 0.2 * 0.1**2  # kg, m, kg·m² about the hinge
GRAVITY = 9.81


class Bench:
    """One hinge that carries a link, with a servo or a motor: the plant and how to drive it."""

    def __init__(
        self,
        effects: Sequence[Effect] = (),
        values: Any = None,
        actuator: str = SERVO,
        gravity: float = 0.0,
        armature: float = 0.001,
        damping: float = 0.0,
        fixed: Sequence[Any] = (),
    ) -> None:
        text = ARM.format(gravity=-gravity, armature=armature, damping=damping, actuator=actuator)
        self.spec = mujoco.MjSpec.from_string(text)
        values = None if values is None else np.atleast_2d(np.asarray(values, dtype=float))
        n = 1 if values is None else len(values)
        self.ids = np.arange(n)
        self.plant = Plant(self.spec, effects, n, threads=1, fixed=fixed)
        self._force = self.plant.batch.bind("actuator_force")
        self._torque = self.plant.batch.bind("qfrc_actuator")
        if values is not None:
            self.plant.set_params(self.ids, values)

    def reset(self, q: float = 0.0, w: float = 0.0, **arguments: Any) -> None:
        """Start all rows from an angle and a speed."""
        n = len(self.ids)
        seeds = np.arange(n, dtype=np.uint64)
        self.plant.reset(self.ids, np.full((n, 1), q), np.full((n, 1), w), seeds, **arguments)

    def run(self, commands: Any, nstep: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Send commands (T,) to all rows; return true and measured angles, (T, n) each."""
        true, measured = [], []
        for command in np.atleast_1d(commands):
            failed = self.plant.step(None, np.full((len(self.ids), 1), command), nstep)
            assert not failed.any()
            true.append(self.plant.qpos[:, 0].copy())
            measured.append(self.plant.measured(None)[0][:, 0].copy())
        return np.array(true), np.array(measured)

    def hold(self, command: float, seconds: float) -> np.ndarray:
        """Hold a command; return the true angles at the end, (n,)."""
        return self.run(command, round(seconds / STEP))[0][-1]

    @property
    def force(self) -> np.ndarray:
        """The actuator's force in the last substep, (n,)."""
        return self._force[:, 0]

    @property
    def torque(self) -> np.ndarray:
        """Its torque at the hinge, (n,)."""
        return self._torque[:, 0]

    @property
    def speed(self) -> np.ndarray:
        """True speeds, (n,)."""
        return self.plant.qvel[:, 0]


@pytest.fixture
def bench() -> type[Bench]:
    """The class of one-joint benches."""
    return Bench


@pytest.fixture
def one() -> Any:
    """Make an effect at the bench's only place for it."""

    def make_one(name: str, **arguments: Any) -> Effect:
        where = {"joint": "hinge", "actuator": "servo", "body": "link"}
        place = where.get(EFFECTS[name].place)
        return make(name, **({"where": place} if place else {}), **arguments)

    return make_one
