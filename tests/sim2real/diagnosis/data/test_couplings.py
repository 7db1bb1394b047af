"""Gears, differentials and rods lead joints that nobody logged."""

import mujoco
import numpy as np
import pytest

from hardware.log import Log
from sim2real.diagnosis.data.poses import follow_couplings
from sim2real.diagnosis.data.recording import to_recording

BODY = '<geom size="0.02 0.05" type="capsule" mass="0.1" contype="0" conaffinity="0"/>'
GEARS = f"""<mujoco><worldbody>
  <body><joint name="drive" axis="0 0 1"/>{BODY}</body>
  <body><joint name="driven" axis="0 0 1"/>{BODY}<body><joint name="alone"/>{BODY}</body></body>
  <body><joint name="a" axis="1 0 0"/>{BODY}</body><body><joint name="b" axis="1 0 0"/>{BODY}</body>
  <body><joint name="roll" axis="1 0 0"/>{BODY}</body>
</worldbody>
<tendon><fixed name="waist"><joint joint="roll" coef="1"/><joint joint="a" coef="0.25"/>
  <joint joint="b" coef="-0.25"/></fixed></tendon>
<equality><joint joint1="driven" joint2="drive" polycoef="0.1 -0.9 0.2 0 0"/>
  <tendon tendon1="waist"/></equality>
<actuator><position name="drive" joint="drive" kp="2"/></actuator></mujoco>"""
RODS = f"""<mujoco><compiler angle="radian"/><worldbody>
  <body><joint name="crank" axis="0 1 0"/>{BODY}
    <body pos="0.1 0 0"><joint name="rod" axis="0 1 0"/>{BODY}
      <site name="end" pos="0.25 0 0"/></body></body>
  <body pos="0.2 0 0"><joint name="rocker" axis="0 1 0"/>{BODY}
    <site name="pin" pos="0.2 0 0"/></body>
</worldbody><equality><connect site1="end" site2="pin"/></equality></mujoco>"""


def places(model: mujoco.MjModel, *names: str) -> list[int]:
    """Return where joints are in qpos, which is where they are in qvel."""
    return [int(model.joint(name).qposadr[0]) for name in names]


def test_a_gear_and_a_differential_follow_their_drives() -> None:
    """Positions by the laws of the file, speeds by their slopes; a joint without any stays."""
    model = mujoco.MjModel.from_xml_string(GEARS)
    known = places(model, "drive", "a", "b")
    qpos, qvel = np.zeros(model.nq), np.zeros(model.nv)
    qpos[known], qvel[known] = [0.5, 0.8, -0.4], [2.0, 1.0, -3.0]
    found, speeds = follow_couplings(model, qpos, qvel, known)
    driven, roll, alone = places(model, "driven", "roll", "alone")
    assert found[driven] == pytest.approx(0.1 - 0.9 * 0.5 + 0.2 * 0.25)
    assert speeds[driven] == pytest.approx((-0.9 + 0.4 * 0.5) * 2.0)
    assert found[roll] == pytest.approx(0.25 * (-0.4 - 0.8))
    assert speeds[roll] == pytest.approx(0.25 * (-3.0 - 1.0))
    assert found[alone] == speeds[alone] == 0.0
    np.testing.assert_array_equal(found[known], qpos[known])


@pytest.mark.parametrize("kind", ["dense", "sparse"])
def test_rods_close_their_loop(kind: str) -> None:
    """The crank's angle says those of rod and rocker, and its speed moves the pin with the end."""
    model = mujoco.MjModel.from_xml_string(
        RODS.replace("<worldbody>", f'<option jacobian="{kind}"/><worldbody>', 1)
    )
    (crank,) = places(model, "crank")
    start, before = np.array([0.4, -1.2, -1.2]), model.opt.jacobian
    found, speeds = follow_couplings(model, start, np.array([1.5, 0, 0]), [crank])
    assert model.opt.jacobian == before
    ends = []
    for qpos in (found, found + 1e-6 * speeds):
        data = mujoco.MjData(model)
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        ends.append(data.site("end").xpos - data.site("pin").xpos)
    np.testing.assert_allclose(ends[0], 0.0, atol=1e-8)
    np.testing.assert_allclose(ends[1], 0.0, atol=1e-10)
    assert found[crank] == 0.4 and speeds[crank] == 1.5


def test_a_replay_from_the_middle_starts_with_its_gear_there() -> None:
    """A window of a log that holds the drive alone."""
    time = np.arange(40) * 0.02
    angle = 0.6 * np.sin(5 * time)
    columns = {"episode": 0 * time, "time": time, "ctrl.drive": angle, "qpos.drive": angle}
    log = Log(columns | {"qvel.drive": 3 * np.cos(5 * time)})
    model = mujoco.MjModel.from_xml_string(GEARS)
    recording = to_recording(log, model, 10, 30)
    drive, driven = places(model, "drive", "driven")
    q, v = angle[10], 3 * np.cos(5 * time[10])
    assert recording.qpos[drive] == q
    assert recording.qpos[driven] == pytest.approx(0.1 - 0.9 * q + 0.2 * q**2)
    assert recording.qvel[driven] == pytest.approx((-0.9 + 0.4 * q) * v)
