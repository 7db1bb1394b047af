"""Motions stay within limits, start and end in their pose, and are driven without a complaint."""

from typing import get_args

import numpy as np
import pytest

from hardware.config import load_robot
from hardware.connect import make_driver
from hardware.errors import RobotError
from hardware.excite import Kind, allowed_motions, excite
from hardware.record import record
from hardware.safety import Guard

KINDS = get_args(Kind)


@pytest.mark.parametrize("kind", KINDS)
def test_a_motion_stays_within_limits(kind):
    """Angles stay in their part of the limits; smooth kinds keep the speed; all begin at rest."""
    robot = load_robot("arm6")
    pose = np.array([0.0, -0.4, 1.0, 0.3, 0.0, 0.5])
    plan = excite(robot, pose, 8.0, (kind,), np.random.default_rng(1), size=0.5)
    low, high = np.array([servo.position for servo in robot.servos]).T
    reach = 0.5 * np.minimum(pose - low, high - pose)
    assert plan.angles.shape == (400, 6)
    assert (np.abs(plan.angles - pose) <= reach + 1e-12).all()
    np.testing.assert_array_equal(plan.angles[0], pose)
    np.testing.assert_allclose(plan.angles[-1], pose, atol=1e-12)
    assert np.ptp(plan.angles, axis=0).min() > 0.2 * reach.min()
    assert plan.torque.all() == (kind != "swing")
    if kind in ("ramp", "chirp", "multisine"):
        fastest = np.array([servo.velocity for servo in robot.servos])
        assert (np.abs(np.diff(plan.angles, axis=0)).max(axis=0) * robot.rate <= fastest).all()


def test_all_kinds_are_driven():
    """bench1 does every kind over the emulated bus, and is limp only where the plan says so."""
    robot = load_robot("bench1")
    driver = make_driver(robot)
    driver.connect()
    driver.configure()
    plan = excite(robot, np.zeros(1), 12.0, KINDS, np.random.default_rng(2), size=0.5)
    with Guard(driver) as guard:
        guard.arm()
        log = record(guard, plan)
    assert len(log) == len(plan.angles)
    np.testing.assert_array_equal(log.column("torque.hinge"), plan.torque)
    assert 0.02 < 1 - plan.torque.mean() < 0.2
    assert np.ptp(log.column("qpos.hinge")) > 1.5


@pytest.mark.parametrize(
    ("kinds", "size", "pose", "message"),
    [
        (("chrip",), 0.5, 0.0, r"unknown motion 'chrip' \(did you mean 'chirp'"),
        ((), 0.5, 0.0, "needs kinds"),
        (("chirp",), 1.5, 0.0, r"size in \(0, 1\], not 1.5"),
        (("chirp",), 0.5, 2.5, "not within the limits"),
    ],
)
def test_refuses(kinds, size, pose, message):
    """What cannot be driven is refused."""
    robot, rng = load_robot("bench1"), np.random.default_rng(0)
    with pytest.raises(RobotError, match=message):
        excite(robot, np.array([pose]), 1.0, kinds, rng, size=size)


def test_a_robot_that_stands_free_is_never_let_go(caplog):
    """quad8 keeps every motion but the swing, which would let it collapse; alone it is refused."""
    quad, bench = load_robot("quad8"), load_robot("bench1")
    assert allowed_motions(quad, ["ramp", "swing", "hold"]) == ["ramp", "hold"]
    assert "quad8 stands free" in caplog.text
    assert allowed_motions(bench, ["ramp", "swing"]) == ["ramp", "swing"]
    with pytest.raises(RobotError, match="swing needs a robot that hangs"):
        allowed_motions(quad, ["swing"])


@pytest.mark.parametrize("seconds", [0.0, float("nan"), 1e99])
def test_a_motion_has_a_length(seconds):
    """No time and more than a day are refused with the number."""
    robot = load_robot("bench1")
    with pytest.raises(RobotError, match=f"seconds={seconds:g}".replace("+", r"\+")):
        excite(robot, np.zeros(1), seconds, ("ramp",), np.random.default_rng(0))
