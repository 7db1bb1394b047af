"""Sizes of a robot: from its limits, its gains, its commands, what it carries."""

import mujoco
import pytest

from envs.effects import EFFECTS, RobotScale, make

BODY = """<mujoco><worldbody><body><joint name="hinge" axis="0 1 0"/>
    <geom type="sphere" size="0.02" pos="0 0 -0.3" mass="0.5"/></body></worldbody>
    <actuator>{}</actuator></mujoco>"""


def scale(actuator: str, command: float = 0.0) -> RobotScale:
    """Return the sizes of a pendulum with that actuator, whose largest command is given."""
    model = mujoco.MjModel.from_xml_string(BODY.format(actuator))
    return RobotScale(model, commands=lambda name: command)


@pytest.mark.parametrize(
    ("actuator", "command", "torque"),
    [
        ('<motor joint="hinge" gear="2" forcerange="-3 3"/>', 0.4, 6.0),
        ('<position joint="hinge" kp="8" gear="2"/>', 0.4, 8.0),
        ('<motor joint="hinge" gear="2" ctrlrange="-1.5 1"/>', 0.4, 3.0),
        ('<general joint="hinge" gear="2" gainprm="5" ctrlrange="-1 1"/>', 0.4, 10.0),
        ('<motor joint="hinge" gear="2"/>', 0.4, 0.8),
        ('<motor joint="hinge" gear="2"/>', 0.0, 0.5 * 9.81 * 0.3),
    ],
)
def test_the_largest_torque_is_the_best_that_is_known(actuator, command, torque) -> None:
    """Limit, gain, range of commands, commands as logged, and at last the weight that hangs."""
    found = scale(actuator, command)
    assert found.torque_at("hinge") == pytest.approx(torque)
    assert found.torque_at(None) == pytest.approx(torque)


def test_friction_of_a_motor_without_a_limit_is_probed_at_its_own_size() -> None:
    """Not a thousandth of it: what rubs takes a part of the torque that was commanded."""
    probes = make("coulomb_friction", where="hinge").probes(scale('<motor joint="hinge"/>', 2.0))
    assert probes.min() == pytest.approx(0.02) and probes.max() == pytest.approx(0.7)


def test_a_speed_that_is_never_passed_may_be_a_limit() -> None:
    """Commands of at most 4 rad/s whose joint stays at 3: the limit itself is probed."""
    model = mujoco.MjModel.from_xml_string(BODY.format('<position joint="hinge" kp="8"/>'))
    own = RobotScale(model, speeds=lambda name: (2.6, 4.0), reached=lambda joint: 3.0)
    (actuator,) = own.actuators
    assert 3.0 in make("profile_velocity", where=actuator).probes(own)


def test_without_a_place_a_size_is_that_of_all_joints() -> None:
    """The mean torque and inertia, the least friction of the model's own, the fastest command."""
    text = """<mujoco><worldbody><body><joint name="a" axis="0 1 0" frictionloss="0.1"/>
        <geom type="sphere" size="0.02" pos="0 0 -0.3" mass="0.5"/>
        <body><joint name="b" axis="0 1 0" frictionloss="0.3"/>
        <geom type="sphere" size="0.02" pos="0 0 -0.3" mass="0.5"/></body></body></worldbody>
        <actuator><motor name="a" joint="a" forcerange="-3 3"/>
        <motor name="b" joint="b" forcerange="-1 1"/></actuator></mujoco>"""
    speeds = {"a": (1.0, 5.0), "b": (2.0, 3.0)}
    found = RobotScale(
        mujoco.MjModel.from_xml_string(text),
        speeds=speeds.__getitem__,
        heat={"a": 4.0, "b": 9.0}.__getitem__,
        reached={"a": 3.0, "b": 2.0}.__getitem__,
    )
    assert found.torque_at(None) == pytest.approx(2.0)
    assert found.own("dof_frictionloss", None) == pytest.approx(0.1)
    assert found.inertia(None) == pytest.approx((found.inertia("a") + found.inertia("b")) / 2)
    assert (found.speeds_at(None), found.speeds_at("b")) == ((2.0, 5.0), (2.0, 3.0))
    assert (found.heat_at(None), found.heat_at("a")) == (9.0, 4.0)
    assert (found.reached_at(None), found.reached_at("b")) == (3.0, 2.0)


@pytest.mark.parametrize("name", ["dead_zone", "backlash"])
def test_what_acts_beyond_a_threshold_only_is_probed_up_to_its_largest_size(name: str) -> None:
    """No straight line through a small one tells of a large one."""
    servo = scale('<position name="servo" joint="hinge" kp="8"/>', 0.4)
    where = "servo" if name == "dead_zone" else "hinge"
    sizes = EFFECTS[name].sizes
    assert sizes is not None
    probes = make(name, where=where).probes(servo)
    assert probes.reshape(len(probes), -1)[:, 0].max() > sizes.high / 2
