"""The hand beside an emulated robot: plugs, moves, holds, and lets go of what has torque."""

import pytest

from hardware.config import load_robot
from hardware.emulator.hand import SPEED, Hand, as_delivered
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError


def run(world: EmulatedRobot, hand: Hand, seconds: float) -> list[str]:
    """Let time go on and return what the hand says."""
    said, end = [], world.time + seconds
    while world.time < end:
        world.advance(world.time + 0.005)
        if (done := hand.step()) is not None:
            said.append(done)
    return said


def test_a_joint_is_moved_and_held():
    """It goes at a hand's speed, stays against gravity, and falls once torque came and went."""
    world = EmulatedRobot(load_robot("arm2"))
    hand = Hand(world)
    assert hand.obey("move elbow 0.6") is None
    begin = world.time
    said = run(world, hand, 0.2)
    assert said == []
    assert world.mechanics.angle[1] == pytest.approx(SPEED * (world.time - begin), abs=0.03)
    assert run(world, hand, 0.5) == ["elbow is at 0.600 rad"]
    run(world, hand, 1.0)
    assert world.mechanics.angle[1] == pytest.approx(0.6, abs=1e-6)
    world.servos[1].write(64, b"\x01", world.time)
    run(world, hand, 0.1)
    world.servos[1].write(64, b"\x00", world.time)
    run(world, hand, 1.0)
    assert abs(world.mechanics.angle[1] - 0.6) > 0.1


def test_what_has_torque_is_not_moved():
    """A servo with torque is stronger than the hand."""
    world = EmulatedRobot(load_robot("arm2"))
    world.servos[1].write(64, b"\x01", world.time)
    hand = Hand(world)
    hand.obey("move elbow 0.6")
    run(world, hand, 0.5)
    assert world.mechanics.angle[1] == pytest.approx(0, abs=0.02)


def test_factory_servos_share_one_id():
    """All have ID 1 at 57600 bits/s, and nothing of the robot's file."""
    robot = as_delivered(load_robot("quad12"))
    world = EmulatedRobot(robot)
    assert {servo.id for servo in world.servos} == {1}
    assert {servo.baud for servo in world.servos} == {57600}
    assert {servo.memory["return_delay_time"] for servo in world.servos} == {250}
    hand = Hand(world)
    name = robot.names[3]
    assert hand.obey("unplug all") is not None
    assert hand.obey(f"connect {name}") == f"connected: {name}"
    heard = [not world.is_silent(servo, 1.0) for servo in world.servos]
    assert heard == [i == 3 for i in range(12)]


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("mov elbow 1", "expected connect JOINT"),
        ("move elbo 1", r"no joint 'elbo' \(did you mean 'elbow'\?\)"),
        ("move elbow up", "'up' is not an angle in rad"),
        ("connect", "expected connect JOINT"),
    ],
)
def test_what_a_hand_cannot_do(line, sentence):
    """A wrong line is one sentence."""
    with pytest.raises(RobotError, match=sentence):
        Hand(EmulatedRobot(load_robot("arm2"))).obey(line)
