"""Models from files: URDF with its actuators, and what is refused."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.errors import TaskError
from envs.models import load_spec

URDF = """<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 -0.1"/><mass value="0.5"/>
      <inertia ixx="0.001" iyy="0.001" izz="0.0005" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual><geometry><mesh filename="package://arm/none.dae"/></geometry></visual>
    <collision><geometry><mesh filename="package://arm/none.stl"/></geometry></collision>
  </link>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" effort="2" velocity="5"/>
  </joint>
</robot>"""


def urdf(folder: Path, actuators: str | None) -> Path:
    """Write the arm."""
    (folder / "arm.urdf").write_text(URDF)
    if actuators is not None:
        (folder / "arm.actuators.yaml").write_text(actuators)
    return folder / "arm.urdf"


def test_a_urdf_swings_and_is_driven(tmp_path: Path) -> None:
    """Mass and inertia are the URDF's; the servo pulls with kp times the error, up to its range."""
    path = urdf(tmp_path, "shoulder: {kp: 20.0, kv: 0.5, forcerange: [-1.5, 1.5], armature: 0.01}")
    model = load_spec(path).compile()
    data = mujoco.MjData(model)
    assert (model.nu, model.njnt) == (1, 1)
    mujoco.mj_forward(model, data)
    full = np.zeros((1, 1))
    mujoco.mj_fullM(model, data, full)
    assert full[0, 0] == pytest.approx(0.001 + 0.5 * 0.1**2 + 0.01)
    data.ctrl[0], data.qpos[0], data.qvel[0] = 0.05, 0.01, 0.2
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == pytest.approx(20 * (0.05 - 0.01) - 0.5 * 0.2)
    data.ctrl[0] = 1.0
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("actuators", "sentence"),
    [
        (None, r"write arm.actuators.yaml beside it"),
        ("", "a table of actuators is needed"),
        ("sholder: {kp: 20}", r"no joint 'sholder'.*did you mean 'shoulder'"),
        ("shoulder: {kP: 20}", "no key 'kP'"),
        ("shoulder: {kv: 1}", "`kp` is needed"),
        ("shoulder: 20", r"'shoulder': 20 must be a table"),
        ("shoulder: {kp: hard}", "kp='hard' must be a number of 0 or more"),
        ("shoulder: {kp: 20, kv: -1}", "kv=-1 must be a number of 0 or more"),
        ("shoulder: {kp: 20, forcerange: 6}", r"forcerange=6 must be two numbers.*\[-2.0, 2.0\]"),
        ("shoulder: {kp: 20, ctrlrange: [1, -1]}", r"ctrlrange=\[1, -1\] must be two numbers"),
    ],
)
def test_what_is_missing_is_said(tmp_path: Path, actuators: str | None, sentence: str) -> None:
    """A URDF without servos, or with wrong ones, is refused by name."""
    with pytest.raises(TaskError, match=sentence):
        load_spec(urdf(tmp_path, actuators))


def test_a_missing_model_and_broken_xml(tmp_path: Path) -> None:
    """The file is named."""
    with pytest.raises(TaskError, match=r"none.xml: there is no such model"):
        load_spec(tmp_path / "none.xml")
    (tmp_path / "a.urdf").write_text("<robot")
    with pytest.raises(TaskError, match=r"a.urdf: this cannot be read as XML"):
        load_spec(tmp_path / "a.urdf")
