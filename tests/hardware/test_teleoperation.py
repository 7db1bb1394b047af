"""A leader's angles, by the joints' names and each robot's own zeros, and what stops a follower."""

import math
from dataclasses import replace

import numpy as np
import pytest

from hardware.clock import VirtualClock
from hardware.config import Robot, load_robot
from hardware.connect import make_driver
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError, SafetyError, ServoError
from hardware.record import Recording
from hardware.safety import Guard
from hardware.teleoperation import EmulatedPerson, Leader


def leader_of(follower: Robot) -> Robot:
    """Return a leader with the follower's joints in another order, other zeros, IDs and signs."""
    shoulder, elbow = follower.servos
    return replace(
        follower,
        name="leader",
        servos=(
            replace(elbow, id=7, zero=1500, sign=-1, position=(0.0, 0.5)),
            replace(shoulder, id=9, zero=2500),
        ),
    )


class Pair:
    """An emulated leader and its follower in one virtual time, and a guard of the follower."""

    def __init__(self, scaled: tuple[str, ...] = (), angles: np.ndarray | None = None) -> None:
        self.clock, follower = VirtualClock(), load_robot("arm2")
        leader = leader_of(follower)
        self.own, self.world = EmulatedRobot(leader), EmulatedRobot(follower)
        self.own.hold()
        where = np.array([[0.4, -0.3]]) if angles is None else angles
        self.person = EmulatedPerson(self.own, where, follower.rate, self.clock.now)
        own = make_driver(leader, self.own, self.clock)
        self.leader = Leader(own, follower, scaled, self.person)
        self.leader.connect()
        self.driver = make_driver(follower, self.world, self.clock)
        self.driver.connect()
        self.driver.configure()
        self.guard = Guard(self.driver)
        self.recording = Recording(self.guard)


def test_angles_go_by_name(monkeypatch):
    """Another order, other zeros, IDs and signs: the follower gets the joints' angles."""
    pair = Pair()
    assert not pair.own.firmware.torque_on.any()
    assert pair.leader.angles() == pytest.approx([-0.3, 0.4], abs=0.002)
    low, high = load_robot("arm2").servo("elbow").position
    scaled = Pair(scaled=("elbow",)).leader.angles()
    assert scaled == pytest.approx([-0.3, low + 0.8 * (high - low)], abs=0.02)


def test_the_follower_does_what_the_leader_does():
    """It goes to the leader slowly, then follows; the log's commands are the leader's angles."""
    time = np.arange(150) / 50
    moved = np.stack([0.4 * np.cos(2 * time), 0.3 * np.sin(3 * time)], axis=1)
    pair = Pair(angles=moved)
    with pair.guard as guard:
        guard.arm()
        guard.move_to(pair.leader.angles())
        pair.recording.follow(pair.leader.angles, steps=150)
    assert not pair.world.firmware.torque_on.any()
    log = pair.recording.log()
    assert len(log) == 150
    assert log.column("action.shoulder") == pytest.approx(moved[-1, 1], abs=0.6)
    assert np.ptp(log.column("action.shoulder")) > 0.3
    for name in ("shoulder", "elbow"):
        lag = log.column(f"qpos.{name}")[5:] - log.column(f"action.{name}")[:-5]
        assert math.sqrt(float(np.mean(lag**2))) < 0.1


def test_a_silent_leader_stops_the_follower():
    """Five readings without a new answer of one joint: torque off, and the log says why."""
    pair = Pair()
    with (
        pytest.raises(SafetyError, match=r"leader: elbow gave no new answer 5 times.*torque is of"),
        pair.guard as guard,
    ):
        guard.arm()
        guard.move_to(pair.leader.angles())
        pair.own.connect(0, False)
        pair.recording.follow(pair.leader.angles, steps=50)
    assert not pair.world.firmware.torque_on.any()
    assert "no new answer 5 times" in pair.recording.log().meta["stopped"]


def test_other_joints_are_refused():
    """The sentence names the joints that only one of both has."""
    follower = load_robot("arm2")
    other = replace(follower, servos=(replace(follower.servos[0], name="hip"), follower.servos[1]))
    with pytest.raises(RobotError, match=r"'hip' only the leader, 'shoulder' only the follower"):
        Leader(make_driver(other.at("/dev/x")), follower)
    with pytest.raises(RobotError, match=r"no joint 'elbo' \(did you mean 'elbow'\?\)"):
        Leader(make_driver(follower), follower, ("elbo",))


def test_a_leader_that_is_read_too_slowly():
    """A bus on which a reading takes longer than the follower's step is refused before torque."""
    follower = load_robot("arm2")
    slow = replace(follower, rate=1.0, bus=replace(follower.bus, baud=57600, return_delay=0.0005))
    with pytest.raises(ServoError, match=r"arm2: reading it takes .* lower robot\.rate"):
        Leader(make_driver(slow), replace(follower, rate=150.0)).connect()
