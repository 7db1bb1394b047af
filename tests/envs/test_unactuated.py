"""Which robots' bases can be estimated from what they log."""

import mujoco
import pytest

from envs.tasks.servo.base import ASSETS
from envs.unactuated import unobservable_joints_message

CART = """<mujoco><worldbody><body><joint name="rail" type="hinge"/><geom size=".1"/>
<body><joint name="pole"/><geom size=".1"/></body></body>{ground}</worldbody>
<actuator><position joint="pole"/></actuator></mujoco>"""
GROUND = '<geom type="plane" size="1 1 1"/>'


def asset(name: str) -> mujoco.MjModel:
    """Return a model of the project."""
    return mujoco.MjModel.from_xml_path(str(ASSETS / f"{name}.xml"))


@pytest.mark.parametrize("name", ["bench1", "arm6", "hopper2"])
def test_servos_or_feet_tell_where_a_robot_is(name: str) -> None:
    """Arms have nothing loose; a hopper's boom slides, and its foot tells."""
    assert unobservable_joints_message(asset(name), has_imu=False) is None


def test_a_free_base_needs_an_imu() -> None:
    """Feet do not say how it is turned."""
    assert unobservable_joints_message(asset("quad8"), has_imu=True) is None
    why = unobservable_joints_message(asset("quad8"), has_imu=False)
    assert why is not None and why.startswith("moves at root") and "no IMU says how" in why


@pytest.mark.parametrize(("ground", "reason"), [("", "no ground"), (GROUND, "only a free base")])
def test_a_loose_hinge_is_refused(ground: str, reason: str) -> None:
    """By the joint's name, with the reason."""
    why = unobservable_joints_message(
        mujoco.MjModel.from_xml_string(CART.format(ground=ground)), has_imu=True
    )
    assert why is not None and why.startswith("moves at rail") and reason in why
