"""Hidden effects: each changes what it should, and nothing else."""

import numpy as np
import pytest

from envs.effects import EFFECTS as VOCABULARY
from sim2real.exam.logs import difference, overall
from sim2real.exam.thirdparty.hidden import LAWS, known, put
from sim2real.exam.thirdparty.outside import OUTSIDE
from sim2real.exam.thirdparty.robots import ROBOTS, make_rig, plan

pytestmark = pytest.mark.slow
pytest.importorskip("dartpy", reason="needs DART: pip install 'sim2real[engines]'")


def test_names_are_the_vocabularys() -> None:
    """No law inside has a name of its own, none outside has one of the vocabulary's."""
    assert set(LAWS) <= set(VOCABULARY)
    assert not set(OUTSIDE) & set(VOCABULARY)


def test_a_robot_hides_only_what_it_can_have() -> None:
    """A leg of torque motors has no gain; a current loop hides its supply."""
    can = {name: set(known(make_rig(robot))) for name, robot in ROBOTS.items()}
    assert "position_gain" not in can["leg2"]
    assert "supply_voltage" in can["pendulum"] - can["arm3"]
    assert "derivative_gain" in can["arm3"] - can["pendulum"]


@pytest.mark.parametrize(
    "effect",
    ["coulomb_friction", "position_gain", "motor_strength", "payload", "backlash", "command_delay"],
)
def test_an_effect_grows_with_its_size(effect: str) -> None:
    """The gap is less than four counts at the smallest size, and grows from there."""
    robot = ROBOTS["pendulum"]
    rig, ctrl = make_rig(robot, "dart"), plan(robot, 2.5, np.random.default_rng(0))
    law = LAWS[effect]
    joint = None if law.place == "robot" else "pivot"
    draw = law.draw(rig, joint, np.random.default_rng(1))
    bare = rig.drive(ctrl, 1)
    sizes = (law.low, (law.low * law.high) ** 0.5, law.high)
    gaps = [
        overall(difference(put(rig, {"effect": effect, **draw(size)}).drive(ctrl, 1), bare))
        for size in sizes
    ]
    assert gaps[0] < 4 * 2 * np.pi / 4096 < gaps[2]
    assert gaps[0] < gaps[1] < gaps[2]


@pytest.mark.parametrize("effect", sorted(LAWS))
def test_every_size_of_an_effect_has_a_value(effect: str) -> None:
    """To the ends of its range and with either sign: a limit's size is beyond any factor's."""
    rig = make_rig(ROBOTS["pendulum"])
    for seed in range(6):
        draw = LAWS[effect].draw(rig, rig.driven[0], np.random.default_rng(seed))
        for size in (LAWS[effect].low, LAWS[effect].high):
            assert np.isfinite(draw(size)["value"]).all()


def test_shared_effects_are_at_all_joints() -> None:
    """One value for the robot is put into each servo."""
    rig = make_rig(ROBOTS["arm3"], "dart")
    truth = {"effect": "motor_strength", "joint": None, "where": None, "value": 0.8, "shared": True}
    servos = [joint.servo for joint in put(rig, truth).joints.values()]
    assert [servo.strength for servo in servos if servo] == [0.8] * 3


def test_a_knee_is_where_the_torque_begins_to_fall() -> None:
    """As in the library: at that speed the motor's line is at the torque limit."""
    rig = make_rig(ROBOTS["arm3"], "dart")
    truth = {"effect": "torque_speed_knee", "joint": "elbow", "where": "elbow", "value": 3.0}
    servo = put(rig, truth).joints["elbow"].servo
    assert servo is not None
    assert servo.stall * (1 - 3.0 / servo.no_load) == pytest.approx(servo.limit)


def test_two_encoders_see_two_sides() -> None:
    """The firmware reads the motor, the log the link, and the load bends the spring between."""
    rig = make_rig(ROBOTS["arm3"], "dart")
    truth = {"effect": "joint_compliance", "joint": "shoulder", "side": "motor", "value": 0.05}
    hold = np.tile([0.0, 0.4, 0.6], (150, 1))
    seen = {
        side: put(rig, {**truth, "encoder": side}).drive(hold, 1).column("qpos.shoulder")[-1]
        for side in ("motor", "link")
    }
    bare = rig.drive(hold, 1).column("qpos.shoulder")[-1]
    assert seen["motor"] == pytest.approx(bare, abs=0.004)
    assert seen["link"] - seen["motor"] > 0.05  # 2 N·m of load on 20 N·m/rad


def test_a_loose_mount_rocks_under_the_arm() -> None:
    """The foot is no joint of the log, and the arm on it errs."""
    robot = ROBOTS["arm3"]
    rig, ctrl = make_rig(robot, "dart"), plan(robot, 2.5, np.random.default_rng(0))
    loose = OUTSIDE["loose_mount"].put(rig, "yaw", 0.5, np.random.default_rng(0))
    log = loose.drive(ctrl, 1)
    assert log.joints == list(rig.driven)
    assert overall(difference(log, rig.drive(ctrl, 1))) > 1e-4
