"""The bodies' numbers."""

import mujoco
import numpy as np
import pytest

from sim2real.exam.thirdparty.tree import read_tree
from sim2real.runs.errors import Sim2RealError

ARM = (
    '<mujoco><worldbody><body name="a"><joint name="j" axis="0 1 0"/>{geoms}</body></worldbody>'
    "</mujoco>"
)
ROD = '<geom type="capsule" fromto="0 0 0 0.1 0.2 0.3" size="0.02" mass="0.5"/>'
BALL = '<geom type="sphere" pos="0.3 0 0" size="1e-4" mass="0.2"/>'


def test_a_load_is_what_mujoco_makes_of_it() -> None:
    """A point mass moves mass, centre and inertia as a tiny heavy ball does."""
    rod, both = (
        read_tree(mujoco.MjModel.from_xml_string(ARM.format(geoms=geoms)))
        for geoms in (ROD, ROD + BALL)
    )
    loaded, wanted = rod.load("a", 0.2, np.array([0.3, 0, 0])).link("a"), both.link("a")
    assert loaded.mass == pytest.approx(wanted.mass)
    assert loaded.centre == pytest.approx(wanted.centre)
    assert loaded.inertia == pytest.approx(wanted.inertia, abs=1e-8)


def test_a_free_body_is_refused() -> None:
    """The error names the body."""
    box = '<body name="box"><freejoint/><geom size="0.1"/></body>'
    free = f"<mujoco><worldbody>{box}</worldbody></mujoco>"
    with pytest.raises(Sim2RealError, match="box"):
        read_tree(mujoco.MjModel.from_xml_string(free))
