"""Models from files: URDF with its actuators, and what is refused."""

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
        (None, r"write arm.actuators.yaml next to it"),
        ("", "expected a table of actuators"),
        ("sholder: {kp: 20}", r"no joint 'sholder'.*did you mean 'shoulder'"),
        ("shoulder: {kP: 20}", "unknown key 'kP'"),
        ("shoulder: {kv: 1}", r"`kp` \[N·m/rad\] is missing; for a torque motor"),
        (
            "# servos\nshoulder: {kp: 1, x: 2}",
            r"arm.actuators.yaml, line 2, 'shoulder': unknown key",
        ),
        ("shoulder: {type: moter}", r"type='moter' \(did you mean 'motor'"),
        ("shoulder: {type: motor, kp: 2}", "a motor takes torques and has no gains"),
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
    with pytest.raises(TaskError, match=r"none.xml: no such model"):
        load_spec(tmp_path / "none.xml")
    (tmp_path / "a.urdf").write_text("<robot")
    with pytest.raises(TaskError, match=r"a.urdf: cannot be read as XML"):
        load_spec(tmp_path / "a.urdf")


def test_a_urdf_may_have_motors_and_damping(tmp_path: Path) -> None:
    """Torques [N·m] of a motor; damping is linear in the speed."""
    path = urdf(tmp_path, "shoulder: {type: motor, forcerange: [-1.5, 1.5], damping: 0.2}")
    model = load_spec(path).compile()
    data = mujoco.MjData(model)
    data.ctrl[0], data.qvel[0] = 2.0, 0.5
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == pytest.approx(1.5)
    assert data.qfrc_damper[0] == pytest.approx(-0.2 * 0.5)


def test_a_urdf_s_own_element_of_mujoco_is_kept(tmp_path: Path) -> None:
    """Ours is merged into it: there is one compiler, and its choices hold."""
    own = '<mujoco><compiler balanceinertia="true"/><option timestep="0.004"/></mujoco></robot>'
    path = urdf(tmp_path, "shoulder: {kp: 20.0}")
    path.write_text(URDF.replace("</robot>", own))
    assert load_spec(path).compile().opt.timestep == 0.004


def test_a_urdf_may_hang_in_a_world_that_it_does_not_declare(tmp_path: Path) -> None:
    """Any other link that is missing is named, with its line."""
    path = urdf(tmp_path, "shoulder: {kp: 20.0}")
    path.write_text(URDF.replace('<link name="base"/>', "").replace("base", "world"))
    assert load_spec(path).compile().njnt == 1
    path.write_text(URDF.replace('<parent link="base"/>', '<parent link="bse"/>'))
    with pytest.raises(TaskError, match=r"arm.urdf, line 12: .*parent 'bse'.*did you mean 'base'"):
        load_spec(path)


MJCF = """<mujoco><asset><mesh name="shell" file="shell.stl"/>
<texture name="skin" type="2d" file="skin.png"/><material name="skin" texture="skin"/></asset>
<worldbody><body name="arm"><joint name="elbow"/><geom size="0.1" mass="1" material="skin"/>
<geom type="mesh" mesh="shell" {shell}/></body></worldbody>
<actuator><position joint="elbow" kp="3"/><motor joint="elbow"/></actuator></mujoco>"""


def test_pictures_that_are_not_there_are_left_out(tmp_path: Path) -> None:
    """A mesh and a texture that are only looked at; an unnamed actuator goes by its joint."""
    path = tmp_path / "arm.xml"
    path.write_text(MJCF.format(shell='contype="0" conaffinity="0" mass="0"'))
    model = load_spec(path).compile()
    assert (model.ngeom, model.nmesh, model.ntex) == (1, 0, 0)
    assert [model.actuator(i).name for i in range(model.nu)] == ["elbow", ""]


@pytest.mark.parametrize(
    ("shell", "sentence"),
    [("mass='0'", "touches other bodies"), ("contype='0' conaffinity='0'", "gives the body its")],
)
def test_a_mesh_that_matters_is_missed(tmp_path: Path, shell: str, sentence: str) -> None:
    """By its file and its body."""
    path = tmp_path / "arm.xml"
    path.write_text(MJCF.format(shell=shell))
    with pytest.raises(TaskError, match=rf"arm.xml: the mesh 'shell.stl' is missing.*{sentence}"):
        load_spec(path)


def test_a_picture_of_the_world_weighs_nothing(tmp_path: Path) -> None:
    """A mesh that is not there is left out of the ground as well, where nothing touches it."""
    path = tmp_path / "arm.xml"
    table = '<geom type="mesh" mesh="shell" contype="0" conaffinity="0"/></worldbody>'
    path.write_text(
        MJCF.format(shell='contype="0" conaffinity="0" mass="0"').replace("</worldbody>", table)
    )
    assert load_spec(path).compile().ngeom == 1


def test_a_part_of_a_model_is_named_as_one(tmp_path: Path) -> None:
    """A file that others include has another root."""
    path = tmp_path / "motors.xml"
    for root in ("mujocoinclude", "default"):
        path.write_text(f"<{root}><actuator/></{root}>")
        with pytest.raises(TaskError, match=r"a part that other files include: give the whole"):
            load_spec(path)


def test_joints_without_names_go_by_their_bodies(tmp_path: Path) -> None:
    """A base that floats has none in most models; what has a name keeps it."""
    path = tmp_path / "robot.xml"
    leg = '<body><joint/><geom size="0.1"/><body name="foot"><joint name="trunk"/><geom size="1"/>'
    path.write_text(
        '<mujoco><worldbody><body name="base"><freejoint/><geom size="0.1"/>'
        f"{leg}</body></body></body></worldbody></mujoco>"
    )
    model = load_spec(path).compile()
    assert [model.joint(i).name for i in range(model.njnt)] == ["base", "joint1", "trunk"]


@pytest.mark.parametrize(
    ("mass", "inertia", "moments"),
    [
        ("0.03", 'ixx="0.00012" iyy="0.00012" izz="0.00000"', [1.2e-4, 1.2e-4, 1.2e-8]),
        ("1e-6", " ".join(f'i{a}="1e-6"' for a in ("xx", "xy", "xz", "yy", "yz", "zz")), None),
        ("0.03", 'ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="2e-4"', "principal moments are -0.0001,"),
    ],
    ids=["rounded away", "a frame", "a wrong sign"],
)
def test_an_inertia_that_is_not_positive(tmp_path, mass: str, inertia: str, moments) -> None:
    """Rounded or a placeholder's it is made positive; that of no body is named with its line."""
    path = urdf(tmp_path, "shoulder: {kp: 20.0}")
    link = f'<inertial><mass value="{mass}"/><inertia {inertia}/></inertial></link>'
    text = URDF.replace('<link name="base"/>', f'<link name="base">{link}')
    path.write_text(text)
    if isinstance(moments, str):
        with pytest.raises(TaskError, match=rf"arm.urdf, line 2: .*link 'base'.*{moments}"):
            load_spec(path)
        return
    found = load_spec(path).compile().body("base").inertia
    assert (found > 0).all()
    assert moments is None or sorted(found) == pytest.approx(sorted(moments))
