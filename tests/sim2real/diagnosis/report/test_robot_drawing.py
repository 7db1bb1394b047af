"""The drawing of a robot: every joint is where the model has it, names stay apart."""

import re

import mujoco
import numpy as np
import pytest

from hardware.assets import ASSETS
from sim2real.diagnosis.report.robot_drawing import HEIGHT, WIDTH, robot


def numbers(picture: str, pattern: str) -> np.ndarray:
    """Return what a pattern's groups hold, a row a match."""
    return np.array(re.findall(pattern, picture), dtype=float)


@pytest.mark.parametrize("name", ["arm2", "arm6", "quad8", "quad12", "hopper2", "bench1"])
def test_every_joint_is_marked_inside_the_picture(name: str) -> None:
    """Each share has a disc, larger for a larger share; labels do not overlap."""
    model = mujoco.MjModel.from_xml_path(str(ASSETS / f"{name}.xml"))
    joints = [model.joint(i).name for i in range(model.njnt) if model.jnt_type[i] == 3]
    shares = {joint: (k + 1) / sum(range(len(joints) + 1)) for k, joint in enumerate(joints)}
    picture = robot(model, shares)
    discs = numbers(picture, r'class="joint" cx="(.*?)" cy="(.*?)" r="(.*?)"')
    assert len(discs) == len(joints)
    assert (discs[:, :2] >= 0).all() and (discs[:, :2] <= [WIDTH, HEIGHT]).all()
    assert (np.diff(discs[:, 2]) > 0).all() or len(joints) == 1
    for side in ("start", "end"):
        rows = numbers(picture, rf'text-anchor="{side}" x=".*?" y="(.*?)"')
        assert (np.diff(rows) >= 19.9).all()
        assert (rows > 0).all() and (rows < HEIGHT).all()


def test_what_is_higher_is_drawn_higher() -> None:
    """arm2 hangs: its elbow is below its shoulder, in line with it."""
    model = mujoco.MjModel.from_xml_path(str(ASSETS / "arm2.xml"))
    discs = numbers(robot(model, {"shoulder": 0.1, "elbow": 0.9}), r'cx="(.*?)" cy="(.*?)"')
    assert discs[1, 1] - discs[0, 1] > HEIGHT / 4
    assert abs(discs[1, 0] - discs[0, 0]) < WIDTH / 20


def test_names_are_text() -> None:
    """A joint's name with markup in it is escaped."""
    text = (ASSETS / "bench1.xml").read_text().replace("hinge", "&lt;b&gt;x")
    picture = robot(mujoco.MjModel.from_xml_string(text), {"<b>x": 1.0})
    assert "<b>" not in picture and "&lt;b&gt;x" in picture
