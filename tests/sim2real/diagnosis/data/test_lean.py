"""A model without the work that cannot change what it does."""

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from hardware.config import load_robot
from sim2real.diagnosis.data.lean import NEEDLESS, lean, may_touch, untextured
from tests.sim2real.diagnosis import arm


def path_of(spec: mujoco.MjSpec, steps: int = 600) -> np.ndarray:
    """Return where two rows of a model go, (2, K, nq)."""
    batch = Batch(spec.compile(), 2, 1)
    sweep = 0.8 * np.sin(np.arange(steps)[:, None] * 0.02 + np.arange(2))
    ctrl = np.stack([sweep, 0.5 * sweep])
    return batch.rollout(steps, ctrl)["qpos"]


@pytest.mark.parametrize("friction", [0.0, 0.05])
def test_what_touches_nothing_moves_the_same_to_the_bit(friction: float) -> None:
    """Without contacts, and without sorting what is left into islands; the given spec stays."""
    spec = arm.spec()
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    for joint in spec.joints:
        joint.frictionloss = friction
        joint.range, joint.limited = (-0.5, 0.5), True
    made = lean(spec)
    assert all(made.option.disableflags & flag for flag in NEEDLESS)
    assert not spec.option.disableflags
    assert np.array_equal(path_of(made), path_of(spec))


def test_what_may_touch_is_left_alone() -> None:
    """A floor that a link can reach counts, whichever of the two says so; so does a named pair."""
    assert may_touch(arm.spec().compile())
    spec = arm.spec()
    for geom in spec.geoms:
        geom.contype, geom.conaffinity = 0, 0
    link = spec.body("lower").first_geom()
    floor = spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 1], contype=1, conaffinity=0
    )
    assert not may_touch(spec.copy().compile())
    link.name, link.conaffinity = "link", 1
    assert may_touch(spec.copy().compile())
    assert not lean(spec).option.disableflags
    link.conaffinity, floor.contype = 0, 0
    spec.add_pair(geomname1="link", geomname2="floor")
    assert may_touch(spec.copy().compile())


@pytest.mark.parametrize("robot", ["arm6", "quad8"])
def test_textures_go_and_nothing_that_moves(robot: str) -> None:
    """All numbers of the physics stay as they are, and the given spec keeps its textures."""
    spec = mujoco.MjSpec.from_file(str(load_robot(robot).model))
    made, given = untextured(spec).compile(), spec.copy().compile()
    assert given.ntex and not made.ntex and made.nmat == given.nmat
    fields = ("body_mass", "body_inertia", "geom_friction", "dof_armature", "actuator_gainprm")
    for name in (*fields, "geom_matid", "key_qpos"):
        assert np.array_equal(getattr(made, name), getattr(given, name)), name
