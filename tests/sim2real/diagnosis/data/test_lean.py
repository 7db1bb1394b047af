"""A model without the work that cannot change what it does."""

import mujoco
import numpy as np
import pytest
from mujoco.batch import Batch

from envs.effects.inertia import far_end
from hardware.config import load_robot
from sim2real.diagnosis.data.lean import NEEDLESS, lean, may_touch, undrawn
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
    made, given = undrawn(spec).compile(), spec.copy().compile()
    assert given.ntex and not made.ntex and made.nmat == given.nmat
    fields = ("body_mass", "body_inertia", "geom_friction", "dof_armature", "actuator_gainprm")
    for name in (*fields, "geom_matid", "key_qpos"):
        assert np.array_equal(getattr(made, name), getattr(given, name)), name


SHAPES = """<mujoco><asset><mesh name="shell" vertex="{}"/><mesh name="foot" vertex="{}"/></asset>
<worldbody><geom name="floor" type="plane" size="1 1 1"/><body pos="0 0 .3">
<joint name="a" type="slide" axis="0 0 1"/><joint name="b" axis="0 1 0"/>
<inertial pos="0 0 0" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/>
<geom name="shell" type="mesh" mesh="shell" pos="0 0 .1" euler="0 30 0" contype="0"
conaffinity="0"/>
<geom name="foot" type="mesh" mesh="foot" pos=".02 0 -.1"/>
<body pos=".2 0 0"><joint name="c" axis="0 1 0"/>
<geom name="arm" type="mesh" mesh="shell" contype="0" conaffinity="0"/></body>
</body></worldbody><actuator><motor joint="b" gear="0.01"/><motor joint="c" gear="0.01"/></actuator>
</mujoco>"""
CUBE = " ".join(f"{x} {y} {z}" for x in (0, 0.1) for y in (0, 0.05) for z in (0, 0.03))


def test_meshes_that_touch_and_weigh_nothing_are_points() -> None:
    """In their place, by their name; a foot's stays, and that of a body without an inertia."""
    spec = mujoco.MjSpec.from_string(SHAPES.format(CUBE, CUBE))
    for text, left in ((None, 2), ('<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>', 1)):
        if text is not None:
            whole = SHAPES.replace('<joint name="c" axis="0 1 0"/>', f'{text}<joint name="c"/>')
            spec = mujoco.MjSpec.from_string(whole.format(CUBE, CUBE))
        given, made = spec.copy().compile(), lean(spec)
        simulated = made.copy().compile()
        assert simulated.nmesh == left
        shell = given.geom("shell").id
        assert int(simulated.geom("shell").type[0]) == int(mujoco.mjtGeom.mjGEOM_SPHERE)
        for name in ("geom_pos", "geom_quat", "geom_bodyid"):
            assert np.array_equal(getattr(simulated, name)[shell], getattr(given, name)[shell])
        assert simulated.geom("foot").type == given.geom("foot").type
        assert np.array_equal(path_of(made), path_of(spec.copy()))
        assert spec.meshes[0].name == "shell"


def test_the_end_of_a_link_that_is_only_seen_stays() -> None:
    """A shape that touches nothing says where a payload would hang."""
    spec = arm.spec()
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
        geom.parent.explicitinertial = True
        geom.parent.mass, geom.parent.inertia = 0.2, [1e-3] * 3
    given, made = spec.copy().compile(), lean(undrawn(spec)).compile()
    last = given.body("lower").id
    np.testing.assert_array_equal(far_end(made, last), far_end(given, last))
    assert np.linalg.norm(far_end(given, last)) > 0.1
