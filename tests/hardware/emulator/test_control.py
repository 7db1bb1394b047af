"""The emulated control laws follow the manual's diagrams in every operating mode."""

import math

import pytest

from hardware import protocol
from hardware.config import load_robot
from hardware.emulator.faults import Fault
from hardware.emulator.world import EmulatedRobot
from tests.hardware.emulator.host import Host

R = 3.40  # ohm, of an XL330-M288


def test_profile_acceleration_of_velocity_mode(floating):
    """The velocity trajectory reaches V after t1 = 64 V / A milliseconds, in a straight line."""
    floating.set(operating_mode=1, torque_enable=1, profile_acceleration=20, goal_velocity=200)
    floating.wait(0.32)
    assert floating.read(1, "velocity_trajectory") == pytest.approx(100, abs=3)
    assert floating.read(1, "present_velocity") == pytest.approx(100, abs=20)
    floating.wait(0.35)
    assert floating.read(1, "velocity_trajectory") == 200
    floating.wait(1.0)
    assert floating.read(1, "present_velocity") == pytest.approx(200, abs=3)


def test_timed_profile_of_velocity_mode(floating):
    """With time-based profiles the acceleration register is the time of the change [ms]."""
    floating.set(drive_mode=4, operating_mode=1, torque_enable=1)
    floating.set(profile_acceleration=1000, goal_velocity=200)
    floating.wait(0.5)
    assert floating.read(1, "velocity_trajectory") == pytest.approx(100, abs=3)
    floating.wait(0.55)
    assert floating.read(1, "velocity_trajectory") == 200


@pytest.mark.parametrize(
    ("mode", "goal"), [(0, {"goal_current": 1000}), (1, {"goal_velocity": 400})]
)
def test_goal_pwm_limits_current_and_velocity(mode, goal):
    """A jammed servo's current is no more than that of goal PWM: PWM / 885 V / R."""
    host = Host(EmulatedRobot(load_robot("bench1"), faults=[Fault("stuck")]))
    host.set(operating_mode=mode, pwm_slope=255, torque_enable=1, goal_pwm=200, **goal)
    host.wait(1.0)
    assert host.read(1, "present_pwm") == 200
    assert host.world.firmware.current[0] == pytest.approx(200 / 885 * 5.0 / R, rel=1e-3)


def test_the_velocity_law_integrates_on_every_type():
    """An XL430, whose position law has a D part, reaches its goal velocity under load."""
    robot = load_robot("arm6")
    number = next(servo.id for servo in robot.servos if servo.model == "xl430-w250")
    host = Host(EmulatedRobot(robot))
    assert host.write(number, "operating_mode", 1) == 0
    assert host.write(number, "torque_enable", 1) == 0
    assert host.write(number, "goal_velocity", 60) == 0
    host.wait(1.2)
    assert host.read(number, "present_velocity") == pytest.approx(60, abs=3)


def test_reverse_mode_boots_within_a_turn(host):
    """In position mode a reversed servo reads 0 to 4095: minus its encoder, in one turn."""
    mechanics = host.world.mechanics
    mechanics.lock(0, True)
    mechanics.data.qpos[mechanics.qpos] = 0.5
    host.wait(0.01)
    plain = host.read(1, "present_position")
    host.set(drive_mode=1)
    assert host.read(1, "present_position") == 4096 - plain
    host.send(1, protocol.REBOOT)
    host.wait(0.25)
    assert host.read(1, "present_position") == 4096 - plain


def turned(host: Host, turns: float) -> None:
    """Turn a limp servo by hand."""
    mechanics = host.world.mechanics
    mechanics.data.qpos[mechanics.qpos] += 2 * math.pi * turns
    host.wait(0.02)


def test_turns_are_forgotten_in_position_mode(floating):
    """The count goes on while torque is off; torque or the mode brings it into one turn."""
    host = floating
    turned(host, 2.25)
    assert host.read(1, "present_position") == 2048 + 9 * 1024
    host.set(torque_enable=1)
    assert host.read(1, "present_position") == 3072
    host.wait(1.0)
    assert host.read(1, "present_position") == pytest.approx(3072, abs=1)
    host.set(torque_enable=0, operating_mode=4)
    turned(host, 2.0)
    assert host.read(1, "present_position") == pytest.approx(3072 + 8192, abs=1)
    host.set(operating_mode=3)
    assert host.read(1, "present_position") == pytest.approx(3072, abs=1)


def test_large_homing_offsets(host):
    """Position mode ignores an offset beyond 1024 counts; other modes add it."""
    host.set(homing_offset=1024)
    assert host.read(1, "present_position") == 2048 + 1024
    host.set(homing_offset=1025)
    assert host.read(1, "present_position") == 2048
    host.set(operating_mode=4)
    assert host.read(1, "present_position") == 2048 + 1025


def test_another_mode_does_not_jump(floating):
    """A goal of the mode before is none of the new one: the servo stays where it is."""
    host = floating
    host.set(operating_mode=4, torque_enable=1, goal_position=9000)
    host.wait(4.0)
    host.set(torque_enable=0, operating_mode=3)
    host.set(torque_enable=1)
    host.wait(1.0)
    assert host.read(1, "present_position") == pytest.approx(9000 % 4096, abs=3)


def test_units_of_the_velocity_law(floating):
    """Without an I gain PWM = P / 128 e, e in steps of 0.229 turns a minute, at every speed."""
    floating.set(operating_mode=1, pwm_slope=255, velocity_i_gain=0, velocity_p_gain=256)
    floating.set(torque_enable=1, goal_velocity=100)
    for seconds in (0.01, 0.05, 2.0):
        floating.wait(seconds)
        firmware = floating.world.firmware
        error = 100 - firmware.velocity[0] / 0.023980824
        assert firmware.pwm[0] == pytest.approx(2 * error, abs=1)


def test_a_profile_written_in_motion_shapes_the_next_goal(floating):
    """The running move keeps its profile; another goal takes the new one, of whatever kind."""
    floating.set(operating_mode=4, torque_enable=1, profile_velocity=20, goal_position=4000)
    floating.wait(0.5)
    begin = floating.read(1, "position_trajectory")
    floating.set(profile_velocity=0, goal_pwm=800)
    floating.wait(0.5)
    speed = 20 * 0.229 * 4096 / 60  # counts/s
    passed = floating.read(1, "position_trajectory") - begin
    assert passed == pytest.approx(0.515 * speed, rel=0.03)
    floating.set(goal_position=3000)
    floating.wait(0.002)
    assert floating.read(1, "position_trajectory") == 3000


def test_an_acceleration_written_in_motion_shapes_the_next_goal_velocity(floating):
    """So in velocity mode: 64 V / A milliseconds of the first A, whatever is written meanwhile."""
    floating.set(operating_mode=1, torque_enable=1, profile_acceleration=20, goal_velocity=200)
    floating.set(profile_acceleration=0)
    floating.wait(0.31)
    assert floating.read(1, "velocity_trajectory") == pytest.approx(100, abs=3)
    floating.set(goal_velocity=50)
    floating.wait(0.002)
    assert floating.read(1, "velocity_trajectory") == 50


def test_a_lower_current_limit_holds_for_the_goal_before_it():
    """Goal current was set under a higher limit; a jammed servo draws no more than the new one."""
    host = Host(EmulatedRobot(load_robot("bench1"), faults=[Fault("stuck")]))
    host.set(operating_mode=0, goal_current=800, current_limit=200, torque_enable=1)
    host.wait(0.5)
    assert host.world.firmware.current[0] == pytest.approx(0.2, rel=0.02)
    assert host.read(1, "goal_current") == 800
