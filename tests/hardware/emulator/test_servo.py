"""An emulated servo answers, reports and stops as the manual says."""

import struct

import numpy as np
import pytest

from hardware import protocol
from hardware.config import load_robot
from hardware.emulator.faults import Fault
from hardware.emulator.world import EmulatedRobot
from hardware.protocol import instruction_packet
from tests.hardware.emulator.host import BAUD, Host

STEP = 2 * np.pi / 4096
IN_POSITION, ONGOING, FOLLOWING_ERROR = 0x01, 0x02, 0x08


def test_a_new_id_is_answered_from_the_old_one(host):
    """The answer to a write of the ID has the ID that was written to; then the new one is heard."""
    write = instruction_packet(1, protocol.WRITE, struct.pack("<HB", 7, 9))
    ((_, answer),) = host.bus.feed(write, 0.0, BAUD)
    assert answer == protocol.status_packet(1, 0)
    host.wait(0.01)
    assert host.send(1, protocol.PING) == []
    assert [packet.id for packet in host.send(9, protocol.PING)] == [9]
    (packet,) = host.send(9, protocol.FACTORY_RESET, b"\xff")
    assert packet.id == 9


def test_action_to_one_servo_is_answered(host):
    """An action is answered as the manual publishes; without a registered write it is error 2."""
    action = bytes.fromhex("FF FF FD 00 01 03 00 05 02 CE")
    host.send(1, protocol.REG_WRITE, struct.pack("<HB", 65, 1))
    ((_, answer),) = host.bus.feed(action, host.time, BAUD)
    assert answer == bytes.fromhex("FF FF FD 00 01 04 00 55 00 A1 0C")
    host.wait(0.01)
    assert host.read(1, "led") == 1
    (packet,) = host.send(1, protocol.ACTION)
    assert packet.error == protocol.UNKNOWN_INSTRUCTION


def test_clear_only_at_rest(floating):
    """Clear fails while the servo turns, as the manual says, and works when it stands."""
    host, clear = floating, bytes([1, 0x44, 0x58, 0x4C, 0x22])
    host.set(operating_mode=4, torque_enable=1, profile_velocity=100, goal_position=9000)
    host.wait(0.5)
    (packet,) = host.send(1, protocol.CLEAR, clear)
    assert packet.error == protocol.FAIL
    host.wait(6.0)
    (packet,) = host.send(1, protocol.CLEAR, clear)
    assert packet.error == 0
    assert host.read(1, "present_position") == pytest.approx(9000 - 2 * 4096, abs=2)
    host.wait(1.0)
    assert host.read(1, "present_position") == pytest.approx(9000 - 2 * 4096, abs=2)


def test_secondary_id(three):
    """The manual's example: one of the group answers if the number is its own, else nobody does."""
    for number in (1, 2, 3):
        assert three.write(number, "secondary_id", 3) == 0
    light, dark = struct.pack("<HB", 65, 1), struct.pack("<HB", 65, 0)
    assert [p.id for p in three.send(1, protocol.WRITE, light)] == [1]
    assert [three.read(n, "led") for n in (1, 2, 3)] == [1, 0, 0]
    assert [p.id for p in three.send(3, protocol.WRITE, light)] == [3]
    assert [three.read(n, "led") for n in (1, 2, 3)] == [1, 1, 1]
    for number in (1, 2, 3):
        assert three.write(number, "secondary_id", 100) == 0
    assert three.send(100, protocol.WRITE, dark) == []
    assert [three.read(n, "led") for n in (1, 2, 3)] == [0, 0, 0]
    assert three.send(100, protocol.WRITE, struct.pack("<HB", 10, 1)) == []
    assert three.read(1, "drive_mode") == 0
    assert three.send(100, protocol.PING) == []
    assert three.write(1, "secondary_id", 255) == 0
    assert three.send(255, protocol.WRITE, light) == []
    assert three.read(1, "led") == 0


def test_a_slightly_different_speed_is_heard(host):
    """Speeds within 3 % understand each other, as the manual says; others do not."""
    ping = instruction_packet(1, protocol.PING)
    assert len(host.bus.feed(ping, 0.0, 1_020_000)) == 1
    assert host.bus.feed(ping, 0.1, 1_050_000) == []


@pytest.mark.parametrize(
    ("velocity", "acceleration", "way", "kind"),
    [(0, 0, 1500, 0x00), (0, 50, 1500, 0x00), (50, 0, 1500, 0x10), (50, 20, 1500, 0x30),
     (400, 20, 300, 0x20)],
)  # fmt: skip
def test_moving_status_names_the_profile(floating, velocity, acceleration, way, kind):
    """Step, rectangle, trapezoid, and a triangle where the speed cannot be reached.

    v^2 / a is the way that a trapezoid needs at least; in counts: 9.59 V^2 / A.
    """
    floating.set(torque_enable=1, profile_velocity=velocity, profile_acceleration=acceleration)
    floating.set(goal_position=2048 + way)
    status = floating.read(1, "moving_status")
    assert status & 0x30 == kind
    assert bool(status & ONGOING) == bool(kind)
    assert floating.read(1, "moving") == 1
    floating.wait(8.0)
    assert floating.read(1, "moving_status") == kind | IN_POSITION
    assert floating.read(1, "moving") == 0


def test_a_velocity_of_zero_is_a_step(floating):
    """Profile velocity 0 jumps to the goal, whatever the acceleration."""
    floating.set(torque_enable=1, profile_acceleration=1, goal_position=2500)
    floating.wait(0.002)
    assert floating.world.firmware.trajectory[0][0] == 2500


def test_a_running_profile_is_moving():
    """While its goal is on its way a servo is moving, even if it is jammed and stands."""
    host = Host(EmulatedRobot(load_robot("bench1"), faults=[Fault("stuck")]))
    host.set(torque_enable=1, profile_velocity=5, goal_position=2200)
    host.wait(0.2)
    assert host.read(1, "present_velocity") == 0
    assert host.read(1, "moving") == 1


def test_a_jammed_servo_is_not_in_position():
    """At the profile's end a jammed servo reports a following error, and no arrival."""
    host = Host(EmulatedRobot(load_robot("bench1"), faults=[Fault("stuck")]))
    host.set(torque_enable=1, profile_velocity=200, goal_position=2400)
    host.wait(1.0)
    assert host.read(1, "position_trajectory") == 2400
    assert host.read(1, "moving_status") & 0x0F == FOLLOWING_ERROR
    host.set(torque_enable=0)
    host.set(operating_mode=1)
    host.set(torque_enable=1)
    host.wait(0.1)
    assert host.read(1, "moving_status") & (IN_POSITION | FOLLOWING_ERROR) == 0


def tripped(host: Host) -> None:
    """Say nothing until the watchdog has tripped, and see that goals are locked."""
    host.set(bus_watchdog=5)
    host.wait(0.3)
    assert host.read(1, "bus_watchdog") == -1


def test_a_tripped_watchdog_holds_in_position_mode(host):
    """The arm is held where it is, and follows its goals again once the watchdog is cleared."""
    host.set(torque_enable=1, goal_position=2048 + 500)
    host.wait(1.0)
    before = float(host.world.mechanics.angle[0])
    tripped(host)
    host.wait(1.0)
    assert host.world.mechanics.angle[0] == pytest.approx(before, abs=0.3)
    assert host.read(1, "goal_pwm") == 885
    assert host.write(1, "goal_position", 2100) == protocol.BAD_RANGE
    host.set(bus_watchdog=0, goal_position=2048 + 500)
    host.wait(1.5)
    assert host.world.mechanics.angle[0] == pytest.approx(before, abs=0.01)


def test_a_tripped_watchdog_brakes_in_velocity_mode(floating):
    """The manual's example: it stops, refuses goals with error 4, and turns again when cleared."""
    host = floating
    host.set(operating_mode=1, torque_enable=1, profile_acceleration=1, goal_velocity=50)
    host.wait(5.0)
    assert host.read(1, "present_velocity") > 40
    tripped(host)
    host.wait(0.5)
    assert abs(host.read(1, "present_velocity")) <= 1
    assert host.write(1, "goal_velocity", 150) == protocol.BAD_RANGE
    host.set(bus_watchdog=0, profile_acceleration=0, goal_velocity=150)
    host.wait(1.0)
    assert host.read(1, "present_velocity") == pytest.approx(150, abs=3)


@pytest.mark.parametrize(("mode", "goal"), [(0, "goal_current"), (16, "goal_pwm")])
def test_a_tripped_watchdog_stops_pushing(floating, mode, goal):
    """In current mode no current flows, in PWM mode there is no voltage."""
    host = floating
    host.set(operating_mode=mode, torque_enable=1, **{goal: 100})
    host.wait(0.5)
    assert host.world.mechanics.torque[0] > 0
    tripped(host)
    host.wait(1.0)
    assert host.read(1, goal) == 0
    assert host.world.mechanics.torque[0] == pytest.approx(0.0, abs=2e-3)
    assert host.write(1, goal, 50) == protocol.BAD_RANGE
    host.set(bus_watchdog=0, **{goal: 100})
    host.wait(0.5)
    assert host.world.mechanics.torque[0] > 0


def test_only_goals_are_locked_by_the_watchdog(host):
    """Profile registers are no goals: they can be written after a trip."""
    host.set(torque_enable=1)
    tripped(host)
    host.set(profile_acceleration=10, profile_velocity=20, position_p_gain=30)
    assert host.write(1, "goal_pwm", 30) == protocol.BAD_RANGE
    block = struct.pack("<Hii", 112, 40, 2048)
    (packet,) = host.send(1, protocol.WRITE, block)
    assert packet.error == protocol.BAD_RANGE
    assert host.read(1, "profile_velocity") == 20


def test_a_tripped_watchdog_is_cleared_by_zero_only(host):
    """Another time would let it go on as if nothing had happened."""
    host.set(torque_enable=1)
    tripped(host)
    assert host.write(1, "bus_watchdog", 5) == protocol.BAD_RANGE
    assert host.read(1, "bus_watchdog") == -1
    host.set(bus_watchdog=0, goal_position=2048)
    host.set(bus_watchdog=5)
