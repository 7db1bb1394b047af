"""The robots' models compile, and their actuators are what the servos' data say."""

import mujoco
import numpy as np
import pytest

from hardware.config import NO_MODEL, ROBOTS, load_robot
from hardware.emulator.feetech_inner import LARGEST_PWM

ROBOT_NAMES = sorted(  # whose models are ours
    path.stem
    for path in ROBOTS.glob("*.yaml")
    if load_robot(path.stem, needs_model=False).model != NO_MODEL
)


@pytest.fixture(params=ROBOT_NAMES)
def robot_and_model(request):
    """Return each robot of the project with its compiled model."""
    robot = load_robot(request.param)
    return robot, mujoco.MjModel.from_xml_path(str(robot.model))


def test_one_servo_for_each_actuator(robot_and_model):
    """Servos and actuators have the same names, and each actuator drives a joint of its name."""
    robot, model = robot_and_model
    actuators = [model.actuator(i).name for i in range(model.nu)]
    assert actuators == robot.names
    for i, name in enumerate(actuators):
        assert model.joint(model.actuator_trnid[i, 0]).name == name


def test_nominal_actuators_follow_from_the_servos(robot_and_model):
    """kp, force limit and damping are those of the servo's type, gain register and voltage."""
    robot, model = robot_and_model
    for i, servo in enumerate(robot.servos):
        volts = robot.supply_of(servo).voltage
        gain = robot.registers_of(servo)["position_p_gain"]
        kp = servo.type.position_gain(gain, volts)
        assert model.actuator_gainprm[i, 0] == pytest.approx(kp, rel=1e-3)
        assert model.actuator_biasprm[i, 1] == pytest.approx(-kp, rel=1e-3)
        assert model.actuator_biasprm[i, 2] == 0
        stall = servo.type.stall_torque(volts)
        if servo.type.name == "sts3215":
            stall *= LARGEST_PWM / 1000
        np.testing.assert_allclose(model.actuator_forcerange[i], [-stall, stall], rtol=1e-3)
        damping = servo.type.back_emf_damping
        assert model.actuator_damping[i] == pytest.approx(damping, rel=1e-3)
        joint = model.actuator_trnid[i, 0]
        armature = model.dof_armature[model.jnt_dofadr[joint]]
        assert armature == pytest.approx(servo.type.armature, rel=1e-3)


def test_commands_stay_within_the_joints(robot_and_model):
    """The angles that a servo may be commanded to lie within its joint's range, if it has one."""
    robot, model = robot_and_model
    for servo in robot.servos:
        joint = model.joint(model.actuator_trnid[model.actuator(servo.name).id, 0])
        if model.jnt_limited[joint.id]:
            low, high = joint.range
            assert low <= servo.position[0] < servo.position[1] <= high


def test_home_is_a_rest(robot_and_model):
    """Left alone at its home pose with its home command, the robot stays near it for a second."""
    _, model = robot_and_model
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    start = data.qpos.copy()
    for _ in range(round(1 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    assert not data.warning.number.any()
    np.testing.assert_allclose(data.qpos, start, atol=0.15)


@pytest.mark.parametrize("name", ["quad8", "quad12"])
def test_servos_carry_a_quadruped(name):
    """Standing on four legs takes a fifth of the stall torque at most, on two of a trot a third.

    Statics, on feet without friction: a joint carries a quarter of the weight at the foot's
    distance from its axis, less what hangs on it at the distance of its centre; along x for hip and
    knee, along y for the abduction.
    """
    robot = load_robot(name)
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    model.geom_condim[:] = 1
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_step(model, data, 2000)
    weight = 9.81 * model.body_mass.sum()
    for servo in robot.servos:
        kind, leg = servo.name.split("_")
        across, joint = int(kind == "abduct"), model.joint(servo.name)
        axis = data.joint(servo.name).xanchor[across]
        foot = data.geom(f"foot_{leg}").xpos[across] - axis
        hanging = 9.81 * model.body_subtreemass[joint.bodyid[0]]
        centre = data.subtree_com[joint.bodyid[0]][across] - axis
        torque = abs(float(data.actuator(servo.name).force[0]))
        assert torque == pytest.approx(abs(weight / 4 * foot - hanging * centre), abs=0.02)
        stall = servo.type.stall_torque(robot.supply.voltage)
        assert torque < stall / 5
        assert abs(weight / 2 * foot - hanging * centre) < stall / 3


def test_bench_swings_like_a_pendulum():
    """Without its motor, bench1 has the period of its inertia: 2 pi sqrt(I / (m g l))."""
    robot = load_robot("bench1")
    spec = mujoco.MjSpec.from_file(str(robot.model))
    spec.actuators[0].damping[:] = 0
    spec.actuators[0].gainprm[:] = 0
    spec.actuators[0].biasprm[:] = 0
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[0] = 0.01
    times = []
    for _ in range(3000):
        before = data.qpos[0]
        mujoco.mj_step(model, data)
        if before > 0 >= data.qpos[0]:
            times.append(data.time)
    rod, ball, length = 0.015, 0.1, 0.12
    inertia = rod * length**2 / 3 + ball * (length**2 + 0.4 * 0.012**2) + 0.0018
    moment = 9.81 * (rod * length / 2 + ball * length)
    period = 2 * np.pi * np.sqrt(inertia / moment)
    assert np.diff(times).mean() == pytest.approx(period, rel=5e-3)
