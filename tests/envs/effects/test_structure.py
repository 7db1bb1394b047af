from itertools import pairwise

import mujoco
import numpy as np
import pytest

from envs.effects import make
from envs.errors import EffectError
from envs.plant import Plant
from envs.tasks.servo.base import ASSETS

LOAD = 0.2 * 9.81 * 0.1  # gravity torque of the level link [N·m]
SIDES = ["motor", "link"]


def ramp(*ends: float, seconds: float = 2.0) -> np.ndarray:
    """Return slow commands through the ends, a millisecond each."""
    parts = [np.linspace(a, b, round(seconds * 1000)) for a, b in pairwise(ends)]
    return np.concatenate(parts)


@pytest.mark.parametrize("side", SIDES)
def test_backlash_is_the_width_of_the_dead_band(bench, one, side: str) -> None:
    """Between motor and link lies plus or minus half the value, by where the load pulls."""
    play = 0.05
    arm = bench([one("backlash", side=side)], [[play]], gravity=9.81)
    arm.reset()
    arm.hold(0.0, 2.0)
    series = arm.plant.layout.joints[0]
    assert arm.plant.layout.raw_qpos[0, series.q] == pytest.approx(play / 2, abs=1e-4)
    arm.reset(np.pi)  # the other way up, gravity pulls to the other end
    arm.hold(3.0, 2.0)
    assert arm.plant.layout.raw_qpos[0, series.q] == pytest.approx(-play / 2, abs=1e-4)


def test_backlash_before_the_encoder_goes_unseen(bench, one) -> None:
    """On the motor's side the reading is the motor's, the truth differs by half the play."""
    arm = bench([one("backlash", side="motor")], [[0.05]], gravity=9.81)
    arm.reset()
    true, measured = arm.run(np.zeros(2000))
    assert true[-1] - measured[-1] == pytest.approx(0.025, abs=1e-4)
    assert 4 * measured[-1] == pytest.approx(LOAD * np.cos(true[-1]), rel=1e-3)


def test_a_servo_closes_its_loop_over_the_play(bench, one) -> None:
    """On the link's side the reading is the truth, and the sag is that of a robot without play."""
    arm = bench([one("backlash", side="link")], [[0.05]], gravity=9.81)
    arm.reset()
    true, measured = arm.run(np.zeros(3000))
    assert (true == measured).all()
    assert 4 * true[-1] == pytest.approx(LOAD * np.cos(true[-1]), rel=1e-3)


def test_play_is_lost_motion_at_a_reversal(bench, one) -> None:
    """A link that a viscous load brakes trails its motor by half the play, on either way."""
    text = """<mujoco><option timestep="0.001" integrator="implicitfast" gravity="0 0 0"/>
    <worldbody><body name="link"><joint name="hinge" axis="0 1 0" armature="0.001"/>
    <geom type="capsule" size="0.01" fromto="0 0 0 0.2 0 0" mass="0.2"/></body></worldbody>
    <actuator><position name="servo" joint="hinge" kp="20" kv="0.3"/></actuator></mujoco>"""
    play = 0.04
    plant = Plant(mujoco.MjSpec.from_string(text), [one_at("backlash")], 1, 1)
    plant.set_params(np.arange(1), np.array([[play]]))
    plant.reset(np.arange(1), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1, np.uint64))
    brake = plant.batch.bind("xfrc_applied")
    link, motor = [], []
    for command in ramp(0.0, 0.3, 0.0):
        brake[0, 1, 4] = -0.5 * plant.qvel[0, 0]  # a viscous load on the link
        plant.step(None, np.full((1, 1), command), 1)
        link.append(plant.qpos[0, 0])
        motor.append(plant.measured(None)[0][0, 0])
    lag = np.array(motor) - np.array(link)
    assert lag[1900] == pytest.approx(play / 2, abs=1e-3)
    assert lag[-100] == pytest.approx(-play / 2, abs=1e-3)


def one_at(name: str, **arguments):
    """Make a joint effect at the hinge."""
    return make(name, where="hinge", **arguments)


@pytest.mark.parametrize("side", SIDES)
def test_compliance_bends_by_torque_times_value(bench, one, side: str) -> None:
    """At rest the link hangs below its motor by the gravity torque times the value."""
    values = np.array([0.02, 0.1])
    arm = bench([one("joint_compliance", side=side, damping=0.1)], values[:, None], gravity=9.81)
    arm.reset()
    end = arm.hold(0.0, 6.0)
    series = arm.plant.layout.joints[0]
    bend = arm.plant.layout.raw_qpos[:, series.q]
    assert bend == pytest.approx(values * LOAD * np.cos(end), rel=2e-3)


def test_compliance_rings_at_its_own_frequency(bench, one) -> None:
    """Behind a motor that holds still, the link swings at sqrt(k / I)."""
    stiff = '<position name="servo" joint="hinge" kp="4000" kv="40"/>'
    value, inertia = 0.1, 1e-4 + 0.2 * 0.1**2
    arm = bench([one("joint_compliance")], [[value]], stiff, armature=1.0)
    arm.reset(w=0.0)
    series = arm.plant.layout.joints[0]
    arm.plant.layout.raw_qvel[0, series.v] = 1.0
    true = arm.run(np.zeros(2000))[0][:, 0]
    crossings = np.flatnonzero(np.diff(np.sign(true)))
    period = 2 * np.diff(crossings).mean() * 1e-3
    assert period == pytest.approx(2 * np.pi * np.sqrt(inertia * value), rel=0.01)


@pytest.mark.parametrize("name", ["backlash", "joint_compliance"])
@pytest.mark.parametrize("side", SIDES)
def test_neutral_rows_move_as_without_the_joint(bench, one, name: str, side: str) -> None:
    """A structured plant at value 0 agrees with a plain one to rounding."""
    commands = 0.5 * np.sin(np.arange(1000) * 0.01)
    paths = []
    for effects in ([], [one(name, side=side)]):
        arm = bench(effects, gravity=9.81)
        arm.reset(0.1, 0.5)
        paths.append(np.array(arm.run(commands)))
    assert paths[1] == pytest.approx(paths[0], abs=1e-12)


@pytest.mark.parametrize("robot", ["arm2", "quad8", "hopper2"])
def test_neutral_rows_of_a_robot_on_the_ground_move_as_without_the_joints(robot: str) -> None:
    """A joint that is held still leaves the solver's stopping rule, and so contacts, alone."""
    spec = mujoco.MjSpec.from_file(str(ASSETS / f"{robot}.xml"))
    plain, play = (Plant(spec, effects, 2, 1) for effects in ([], [make("backlash")]))
    play.set_params(np.arange(2), np.array([[0.0], [0.02]]))
    model = plain.model
    home = model.key_qpos[0] if model.nkey else model.qpos0
    rest = home[model.jnt_qposadr[model.actuator_trnid[:, 0]]]  # of the servos, (nu,)
    for plant in (plain, play):
        start = np.tile(home, (2, 1)), np.zeros((2, model.nv))
        plant.reset(np.arange(2), *start, np.arange(2, dtype=np.uint64))
    random = np.random.default_rng(0)
    for _ in range(20):
        commands = rest + random.uniform(-0.3, 0.3, (2, model.nu))
        for plant in (plain, play):
            assert not plant.step(None, commands, 20).any()
    assert play.qpos[0] == pytest.approx(plain.qpos[0], abs=1e-12)
    assert np.abs(play.qpos[1] - plain.qpos[1]).max() > 1e-3


@pytest.mark.parametrize("name", ["backlash", "joint_compliance"])
@pytest.mark.parametrize("side", SIDES)
def test_a_reset_keeps_the_state_that_is_given(bench, one, name: str, side: str) -> None:
    """Truth stays truth and readings stay readings; the joint begins where the load leaves it."""
    arm = bench([one(name, side=side)], [[0.05], [0.0]], gravity=9.81)
    arm.reset(0.2, 0.7)
    assert arm.plant.qpos[:, 0] == pytest.approx(0.2, abs=1e-12)
    assert arm.plant.qvel[:, 0] == pytest.approx(0.7, abs=1e-12)
    arm.reset(0.2, 0.7, measured=True)
    assert arm.plant.measured(None)[0][:, 0] == pytest.approx(0.2, abs=1e-12)
    resting = arm.plant.layout.raw_qpos[0, arm.plant.layout.joints[0].q]
    assert resting > 0.0  # gravity pulls the link to larger angles


def test_keyframes_survive_the_edit(bench, one) -> None:
    """`home` of the simulated model is `home` of the given one, with the added joint at 0."""
    arm = bench([one("backlash"), one("joint_compliance")])
    model = arm.plant.model
    key = model.key("home")
    assert model.njnt == 3
    assert key.qpos[model.joint("hinge").qposadr[0]] == 0.3
    assert np.count_nonzero(key.qpos) == 1
    assert key.ctrl == [0.3]
    assert arm.plant.nominal.key("home").qpos == [0.3]


def test_room_for_keyframes_is_no_keyframe() -> None:
    """A model may ask for more than it has, as Gymnasium's humanoid does: they stay empty."""
    xml = """<mujoco><size nkey="3"/><worldbody><body><joint name="a"/><geom size="0.1"/></body>
      </worldbody><actuator><position name="a" joint="a" kp="5"/></actuator></mujoco>"""
    play = make("backlash", where="a")
    plant = Plant(mujoco.MjSpec.from_string(xml), [play], threads=1)
    assert plant.model.nq == 2
    assert plant.model.nkey >= 3
    assert not plant.model.key_qpos[:, 1].any()


def test_play_and_spring_stand_in_series(bench, one) -> None:
    """Both may be at one joint; the truth is the sum of all three angles."""
    arm = bench([one("backlash"), one("joint_compliance")], [[0.04, 0.1]], gravity=9.81)
    arm.reset(0.1)
    assert arm.plant.qpos[0, 0] == pytest.approx(0.1, abs=1e-12)
    true, measured = arm.run(np.zeros(4000))
    bend = 0.02 + 0.1 * LOAD * np.cos(true[-1, 0])
    assert true[-1, 0] - measured[-1, 0] == pytest.approx(bend, rel=0.02)


def test_every_driven_joint_at_once() -> None:
    """Without a place, each driven joint gets the same play, and free joints stay as they are."""
    text = """<mujoco><worldbody><body><freejoint/><geom size="0.1"/>
      <body><joint name="a" axis="0 1 0"/><geom size="0.1"/>
      <body pos="0.2 0 0"><joint name="b" axis="0 1 0"/><geom size="0.1"/></body></body></body>
      </worldbody><actuator><position name="u" joint="a"/><position name="v" joint="b"/></actuator>
      </mujoco>"""
    plant = Plant(mujoco.MjSpec.from_string(text), [make("backlash")], 2, 1)
    assert plant.model.njnt == plant.nominal.njnt + 2
    plant.set_params(np.arange(2), np.array([[0.02], [0.0]]))
    qpos = np.tile([0.0, 0, 1, 1, 0, 0, 0, 0.1, 0.2], (2, 1))
    plant.reset(np.arange(2), qpos, np.zeros((2, 8)), np.zeros(2, np.uint64))
    assert plant.qpos == pytest.approx(qpos, abs=1e-12)
    assert not plant.step(None, np.zeros((2, 2)), 10).any()
    assert plant.qpos.shape == (2, 9)


def test_an_unknown_joint_is_refused_with_the_nearest(bench) -> None:
    """The names that the model has are listed."""
    with pytest.raises(EffectError, match=r"no hinge or slide 'hing'.*did you mean 'hinge'"):
        bench([make("backlash", where="hing")])
    with pytest.raises(EffectError, match=r"side='middle'.*motor, link"):
        make("backlash", where="hinge", side="middle")


def test_a_joint_that_is_not_its_bodys_last_is_refused() -> None:
    """The play would turn with the joints after it."""
    text = """<mujoco><worldbody><body name="wrist"><joint name="a" axis="0 1 0"/>
      <joint name="b" axis="1 0 0"/><geom size="0.1"/></body></worldbody></mujoco>"""
    spec = mujoco.MjSpec.from_string(text)
    with pytest.raises(EffectError, match="'a' is not the last joint of body 'wrist'"):
        Plant(spec, [make("backlash", where="a")], 1, 1)
    assert Plant(spec, [make("backlash", where="b")], 1, 1).model.njnt == 3
