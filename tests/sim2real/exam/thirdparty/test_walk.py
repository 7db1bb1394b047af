"""Walks in Drake: as the emulator's at first, with the channels of a robot that walks."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.ground_walks import walked
from hardware.config import load_robot
from hardware.log import Log
from sim2real.exam.thirdparty.walk import Walk, hide, make_walk
from sim2real.runs.errors import Sim2RealError

pytest.importorskip("pydrake", reason="needs Drake; pip install 'sim2real[engines]'")

ROWS = 15  # of 20 ms


@pytest.fixture(scope="module")
def walk() -> Walk:
    """quad8 in Drake."""
    return make_walk(load_robot("quad8"))


@pytest.fixture(scope="module")
def emulated() -> Log:
    """The emulator's walk."""
    return walked("quad8", [], 11, 1)[0]


def gone(walk: Walk, emulated: Log) -> Log:
    """Return the beginning of a walk under the emulator's commands."""
    ctrl = np.column_stack([emulated.column(f"ctrl.{joint}") for joint in walk.rig.driven])
    return walk.go(ctrl[:ROWS], (emulated.time - emulated.time[0])[:ROWS], 0)


def test_it_walks_as_the_emulator_does(walk: Walk, emulated: Log) -> None:
    """Joints within 15 mrad and the base's turn within 10 mrad, for the first 0.3 s."""
    made = gone(walk, emulated)
    for name in walk.rig.driven:
        off = made.column(f"qpos.{name}") - emulated.column(f"qpos.{name}")[:ROWS]
        assert np.sqrt(np.mean(off**2)) < 0.015
        assert (made.column("time") - made.column(f"stamp.{name}") > 0).all()
    for axis in "xyz":
        off = made.column(f"quat.imu.{axis}") - emulated.column(f"quat.imu.{axis}")[:ROWS]
        assert np.sqrt(np.mean(off**2)) < 0.010
    moved = np.ptp(made.column(f"qpos.{walk.rig.driven[1]}"))
    assert moved > 0.1


def test_what_an_imu_gets_wrong_is_in_its_channels_alone(walk: Walk, emulated: Log) -> None:
    """A bias is added, a delay shifts, a mounting turns; encoders are as before."""
    plain = gone(walk, emulated)
    biased = gone(hide(walk, {"effect": "gyro_bias", "value": [0.1, 0, 0]}), emulated)
    np.testing.assert_allclose(
        biased.column("gyro.imu.x") - plain.column("gyro.imu.x"), 0.1, atol=1e-9
    )
    late = gone(hide(walk, {"effect": "imu_delay", "value": 0.02}), emulated)
    np.testing.assert_allclose(
        late.column("quat.imu.y")[1:], plain.column("quat.imu.y")[:-1], atol=1e-3
    )
    askew = gone(hide(walk, {"effect": "imu_mounting", "value": [0.1, 0.0, 0.0]}), emulated)
    turn = 2 * (askew.column("quat.imu.x") - plain.column("quat.imu.x"))
    np.testing.assert_allclose(turn, 0.1, atol=5e-3)
    for other in (biased, late, askew):
        assert np.array_equal(other.column("qpos.hip_fl"), plain.column("qpos.hip_fl"))


def test_a_load_makes_it_sag(walk: Walk, emulated: Log) -> None:
    """A hidden payload adds its mass; friction and strength are the rig's own laws."""
    loaded = hide(walk, {"effect": "payload", "where": "torso", "value": 0.3})
    masses = [sum(link.mass for link in one.rig.tree.links) for one in (walk, loaded)]
    assert masses[1] - masses[0] == pytest.approx(0.3)
    weak = hide(walk, {"effect": "motor_strength", "where": "knee_br", "value": 0.6})
    servo = weak.rig.joints["knee_br"].servo
    assert servo is not None and servo.strength == 0.6
    icy = hide(walk, {"effect": "ground_friction", "where": None, "value": 0.2})
    assert (icy.friction, walk.friction) == (0.2, 0.8)
    with pytest.raises(Sim2RealError, match="'contact_stiffness' is not an effect"):
        hide(walk, {"effect": "contact_stiffness", "where": None, "value": 2.0})


def test_a_robot_without_an_imu_is_refused() -> None:
    """Nothing would say how the base turns."""
    with pytest.raises(Sim2RealError, match="quad8: an IMU and feet"):
        make_walk(replace(load_robot("quad8"), imu=None))
