"""The protocol of engines, on the one that is always there."""

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from envs.effects import EFFECTS
from envs.errors import EffectError, TaskError
from envs.physics import ENGINES, make_physics
from envs.physics.arrays import NUMPY
from envs.plant import Plant
from envs.tasks import Hopper

PENDULUM = """
<mujoco><option timestep="0.01"/><worldbody><body><joint name="hinge" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -1" size=".05"/></body></worldbody>
<actuator><motor name="motor" joint="hinge"/></actuator></mujoco>
"""


def test_an_engine_steps_the_rows_it_is_asked_to() -> None:
    """Rows that are not among ids keep their state; the others are as MuJoCo steps them."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    physics = make_physics("batch", Batch(model, 3))
    qpos, ctrl = physics.bind("qpos"), physics.bind("ctrl")
    qpos[:], ctrl[:] = 0.3, 0.5
    physics.step(np.array([0, 2]), 5)
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = 0.3, 0.5
    mujoco.mj_step(model, data, 5)
    assert np.array_equal(qpos, np.array([data.qpos[:], [0.3], data.qpos[:]]))
    assert not physics.broken(slice(None)).any()


def test_broken_rows_are_told_once() -> None:
    """A row whose state diverged is broken at the next look, and not at the one after."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    physics = make_physics("batch", Batch(model, 2))
    physics.bind("qvel")[1] = np.inf
    physics.step(None, 1)
    assert physics.broken(slice(None)).tolist() == [False, True]
    assert not physics.broken(slice(None)).any()


def test_an_unknown_engine_is_refused_by_name() -> None:
    """The message lists what there is."""
    batch = Batch(mujoco.MjModel.from_xml_string(PENDULUM), 1)
    with pytest.raises(TaskError, match=r"physics='wrap' is unknown.*warp.*batch, warp"):
        make_physics("wrap", batch)  # type: ignore[arg-type]


def test_effects_name_engines_that_there_are() -> None:
    """Every effect works on the CPU, and none on an engine that is unknown."""
    for effect in EFFECTS.values():
        assert "batch" in effect.engines
        assert set(effect.engines) <= set(ENGINES)


def test_an_effect_that_an_engine_lacks_is_refused_before_any_work() -> None:
    """The message names a user's effect for NumPy, and those that work."""

    class Own(EFFECTS["dead_zone"]):
        engines = ("batch",)

    with pytest.raises(
        EffectError,
        match=r"dead_zone does not work with physics=warp; .* use physics=batch\. .*armature, asym",
    ):
        Plant(Hopper().spec(), [Own()], physics="warp")


def test_arrays_of_the_host_are_numpys_own() -> None:
    """Nothing is copied and nothing converted on the CPU."""
    x = np.arange(3.0)
    assert NUMPY.own(x) is x
    assert NUMPY.host(x) is x
    assert NUMPY.rows(None) == slice(None)
    assert NUMPY.zeros((2, 3)).dtype == np.float64
