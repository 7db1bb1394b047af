"""Legs: what swing and bend mean in the models of the robots."""

import mujoco
import numpy as np

from envs.tasks import Hopper2, Quad8, Quad12
from envs.tasks.servo.legs import Gait, joints, reach, roll_pitch, spread


def test_swing_goes_forward_and_extension_makes_long() -> None:
    """The feet of both models are where swing and bend say."""
    for task, feet, link in (
        (Quad8(), [f"foot_{leg}" for leg in ("fl", "fr", "bl", "br")], 0.08),
        (Hopper2(), ["foot"], 0.06),
    ):
        model = task.spec().compile()
        data = mujoco.MjData(model)
        swing, extension = np.full((1, len(feet)), 0.2), np.full((1, len(feet)), 0.1)
        data.qpos[:] = model.key("home").qpos
        data.qpos[task.q] = joints(swing, extension, task.home_bend)[0]
        mujoco.mj_kinematics(model, data)
        for i, name in enumerate(feet):
            hip = data.joint(model.actuator_trnid[2 * i, 0]).xanchor
            foot = data.geom(name).xpos - hip
            length = 2 * link * np.cos(task.home_bend - 0.1)
            np.testing.assert_allclose(foot[0], length * np.sin(0.2), atol=1e-9)
            down = reach(data.qpos[task.q][None], link)[0, i]
            np.testing.assert_allclose(-foot[2], down, atol=1e-9)
            np.testing.assert_allclose(down, length * np.cos(0.2), atol=1e-9)


def test_abduction_goes_outwards_on_either_side() -> None:
    """Each foot of quad12 turns about its shoulder's axis by the abduction, away from the robot."""
    task = Quad12()
    model = task.spec().compile()
    data = mujoco.MjData(model)
    data.qpos[:] = model.key("home").qpos
    turned = 0.25
    swing, extension = np.array([[0.2, -0.1, 0.0, 0.1]]), np.array([[0.1, 0.0, -0.1, 0.0]])
    angles = joints(swing, extension, task.home_bend)
    data.qpos[task.q] = spread(np.full((1, 4), turned), angles)[0]
    mujoco.mj_kinematics(model, data)
    length = 0.2 * np.cos(task.home_bend - extension[0])
    for i, leg in enumerate(("fl", "fr", "bl", "br")):
        out = 1.0 if leg[1] == "l" else -1.0
        foot = data.geom(f"foot_{leg}").xpos - data.joint(f"abduct_{leg}").xanchor
        aside, down = 0.05, length[i] * np.cos(swing[0, i])  # m, in the plane of the leg
        np.testing.assert_allclose(foot[0], length[i] * np.sin(swing[0, i]), atol=1e-9)
        wanted = aside * np.cos(turned) + down * np.sin(turned)
        np.testing.assert_allclose(out * foot[1], wanted, atol=1e-9)
        wanted = aside * np.sin(turned) - down * np.cos(turned)
        np.testing.assert_allclose(foot[2], wanted, atol=1e-9)


def test_a_leg_is_short_on_its_way_forward() -> None:
    """The swing grows where the extension is negative."""
    phase = np.linspace(0, 2 * np.pi, 100)
    swing, extension = Gait(2.0, 0.3, 0.2).pattern(phase)
    assert (np.gradient(swing)[1:-1] * extension[1:-1] <= 1e-9).all()


def test_roll_and_pitch_come_back() -> None:
    """A rotation made of yaw, pitch and roll gives its roll and pitch, whatever its yaw."""
    rng = np.random.default_rng(0)
    for roll, pitch, yaw in rng.uniform(-1.2, 1.2, (20, 3)):
        quaternion = np.array([1.0, 0, 0, 0])
        for axis, angle in (((0, 0, 1), yaw), ((0, 1, 0), pitch), ((1, 0, 0), roll)):
            turn, product = np.zeros(4), np.zeros(4)
            mujoco.mju_axisAngle2Quat(turn, np.array(axis, float), angle)
            mujoco.mju_mulQuat(product, quaternion, turn)
            quaternion = product
        np.testing.assert_allclose(roll_pitch(quaternion[None])[0], [roll, pitch], atol=1e-12)
