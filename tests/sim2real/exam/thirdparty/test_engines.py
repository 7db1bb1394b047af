"""Engines that are built from compiled numbers."""

from typing import Literal

import mujoco
import numpy as np
import pytest

from sim2real.exam.thirdparty.engines import MODULES, make_engine
from sim2real.exam.thirdparty.robots import ROBOTS, nominal
from sim2real.exam.thirdparty.tree import read_tree
from sim2real.runs.errors import Sim2RealError

STEP = 0.0001


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["drake", "dart"])
@pytest.mark.parametrize("name", ROBOTS)
def test_free_motion_is_mujocos(name: str, engine: Literal["drake", "dart"]) -> None:
    """Masses, inertias, frames, axes and gravity came over: half a second's swing is the same."""
    pytest.importorskip(MODULES[engine], reason="needs the extra sim2real[engines]")
    spec = nominal(ROBOTS[name])
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for joint in spec.joints:
        joint.frictionloss, joint.damping = 0.0, np.zeros(3)
    for key in list(spec.keys):
        spec.delete(key)
    spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_EULER
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos, data.qvel = np.full(model.nq, 0.5), np.linspace(1, -1, model.nv)
    tree = read_tree(model)
    rotors = {n: float(a) for n, a in zip(tree.names, model.dof_armature, strict=True)}
    other = make_engine(engine, tree, rotors, STEP)
    other.place(np.array(data.qpos), np.array(data.qvel))
    for _ in range(5000):
        mujoco.mj_step(model, data)
        q, v = other.step(np.zeros(model.nv))
    assert q == pytest.approx(data.qpos, abs=1e-9)
    assert v == pytest.approx(data.qvel, abs=1e-8)


def test_an_unknown_engine_is_refused() -> None:
    """The error names the engines that there are."""
    tree = read_tree(nominal(ROBOTS["pendulum"]).compile())
    with pytest.raises(Sim2RealError, match="one of drake, dart"):
        make_engine("bullet", tree, {"pivot": 0.0}, STEP)  # type: ignore[arg-type]
