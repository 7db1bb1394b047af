"""The emulated servos' motion, currents and temperatures follow from closed forms."""

import struct

import mujoco
import numpy as np
import pytest

from hardware.config import Robot, load_robot
from hardware.emulator.bus import Bus
from hardware.emulator.faults import Fault
from hardware.emulator.hidden import HiddenEffects, make_hidden
from hardware.emulator.profile import Profile
from hardware.emulator.world import EmulatedRobot
from hardware.protocol import BROADCAST, REBOOT, WRITE, instruction_packet
from tests.hardware.emulator.host import put

STEP = 2 * np.pi / 4096
K, R = 0.386, 3.40  # of an XL330-M288


def started(robot: Robot, hidden: HiddenEffects | None = None, **kwargs) -> EmulatedRobot:
    """Return a world whose servos hold their position with the robot's registers."""
    world = EmulatedRobot(robot, hidden, **kwargs)
    ram = {n: v for n, v in robot.registers.items() if n not in ("shutdown",)}
    put(world, **ram, torque_enable=1)
    return world


def angle(world: EmulatedRobot) -> float:
    """The first servo's reading [rad]."""
    return float((world.firmware.present()[0][0] - 2048) * STEP)


def test_the_nominal_model_agrees_with_the_emulator():
    """With nothing hidden, replaying the commands in bench1.xml stays within half a count RMS.

    The commands act one millisecond after they are written, as the robot's file declares.
    """
    robot = load_robot("bench1")
    world = started(robot)
    bus = Bus(world)
    times, commands, readings = [], [], []
    for k in range(200):
        t = 1 + 0.02 * k
        world.advance(t)
        goal = round((np.sin(3 * t + 0.5 * (t - 1) ** 2) + 0.5 * (k // 50 % 2)) / STEP)
        readings.append(angle(world))
        data = struct.pack("<Hi", 116, 2048 + goal)
        bus.feed(instruction_packet(1, WRITE, data), t, robot.bus.baud)
        times.append(t - 1)
        commands.append(goal * STEP)
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    data = mujoco.MjData(model)
    track = []
    for k in range(4000):
        row = np.searchsorted(np.array(times) + robot.command_delay, data.time + 1e-9, "right") - 1
        data.ctrl[0] = commands[max(row, 0)]
        if k % 20 == 0:
            track.append(data.qpos[0])
        mujoco.mj_step(model, data)
    error = np.array(track) - readings
    assert np.ptp(readings) > 1.5
    assert np.sqrt(np.mean(error**2)) < 0.5 * STEP


def test_position_law_at_rest():
    """At rest the P law balances gravity: kp (goal - q) = m g l sin q."""
    world = started(load_robot("bench1"))
    put(world, goal_position=2048 + 1000)
    world.advance(3.0)
    q = float(world.mechanics.angle[0])
    kp = 800 / 256 / 885 / STEP * 5.0 * K / R
    moment = 9.81 * (0.015 * 0.06 + 0.1 * 0.12)
    assert kp * (1000 * STEP - q) == pytest.approx(moment * np.sin(q), abs=2 * kp * STEP)


def test_integral_gain_removes_the_sag():
    """With an I gain the servo ends within a count of its goal."""
    world = started(load_robot("bench1"))
    put(world, position_i_gain=400, goal_position=3000)
    world.advance(6.0)
    assert abs(world.firmware.count[0] - 3000) <= 1


def test_no_load_speed_and_open_circuit(chain):
    """At full PWM the speed tends to V / K; without torque the motor does not brake."""
    world = EmulatedRobot(chain(1, option='gravity="0 0 0"'))
    put(world, operating_mode=16, pwm_slope=255, torque_enable=1, goal_pwm=885)
    world.advance(2.0)
    assert world.mechanics.speed[0] == pytest.approx(5.0 / K, rel=1e-3)
    assert world.firmware.velocity[0] == pytest.approx(5.0 / K, rel=0.02)
    put(world, torque_enable=0)
    world.advance(2.5)
    assert world.mechanics.speed[0] == pytest.approx(5.0 / K, rel=1e-3)
    put(world, torque_enable=1, goal_pwm=0)
    world.advance(3.0)
    assert abs(world.mechanics.speed[0]) < 0.1


def test_velocity_and_current_modes(chain):
    """Velocity mode reaches its goal; current mode gives K i of torque."""
    world = EmulatedRobot(chain(1, option='gravity="0 0 0"'))
    put(world, operating_mode=1, pwm_slope=255, torque_enable=1, goal_velocity=200)
    world.advance(2.0)
    assert world.firmware.velocity[0] == pytest.approx(200 * 0.02398, rel=0.03)
    world = EmulatedRobot(load_robot("bench1"))
    put(world, operating_mode=0, pwm_slope=255, torque_enable=1, goal_current=100)
    world.advance(4.0)
    assert world.mechanics.torque[0] == pytest.approx(0.1 * K, rel=0.05)


def test_current_based_position_is_soft():
    """In mode 5 the goal current limits the torque, not the stiffness near the goal."""
    world = EmulatedRobot(load_robot("bench1"), faults=[Fault("stuck")])
    put(world, operating_mode=5, pwm_slope=255, torque_enable=1, goal_current=200)
    put(world, goal_position=3000)
    world.advance(0.5)
    assert world.firmware.current[0] == pytest.approx(0.2, rel=0.02)


def test_stall_current_and_sag():
    """A stalled servo draws V / R, and a supply of inner resistance r gives V0 - r i."""
    hidden = make_hidden([{"effect": "supply_sag", "value": 0.5}], load_robot("bench1"))
    world = started(load_robot("bench1"), hidden, faults=[Fault("stuck")])
    put(world, goal_position=4000)
    world.advance(0.5)
    assert world.firmware.current[0] == pytest.approx(5.0 / (R + 0.5), rel=1e-2)
    assert world.firmware.supply[0] == pytest.approx(5.0 * R / (R + 0.5), rel=1e-2)


def test_profile_takes_the_time_of_a_trapezoid():
    """A move of d at speed v and acceleration a takes d / v + v / a, and never exceeds either."""
    profile = Profile(np.zeros(1))
    profile.limit(0, 1000.0, 5000.0)
    positions = [0.0]
    while positions[-1] != 800.0 and len(positions) < 5000:
        positions.append(float(profile.advance(np.array([800.0]), 0.001)[0]))
    assert 0.001 * (len(positions) - 1) == pytest.approx(800 / 1000 + 1000 / 5000, abs=0.01)
    speed = np.diff(positions) / 0.001
    assert speed.max() <= 1000 + 1e-6
    assert np.abs(np.diff(speed)).max() / 0.001 <= 5000 * 1.6
    assert max(positions) == 800.0


def test_profile_registers_limit_the_motion():
    """The profile velocity register moves the goal at that many 0.229 turns a minute."""
    world = started(load_robot("bench1"))
    put(world, profile_velocity=40, goal_position=3000)
    world.advance(0.5)
    assert world.firmware.trajectory[0][0] == pytest.approx(2048 + 0.5 * 40 * 0.02398 / STEP, abs=2)


def test_seam_and_turns():
    """In extended mode positions go on beyond a turn; a reboot forgets whole turns."""
    world = EmulatedRobot(load_robot("bench1"))
    put(world, operating_mode=4)
    world.firmware.slip[:] = 3 * np.pi
    world.advance(0.01)
    assert world.firmware.count[0] == pytest.approx(2048 + 1.5 * 4096, abs=3)
    Bus(world).feed(instruction_packet(1, REBOOT), world.time, 1_000_000)
    world.advance(0.3)
    assert 0 <= world.firmware.count[0] < 4096


def test_reverse_mode_mirrors():
    """In reverse mode the servo counts down where it counted up, and still holds its goal."""
    world = EmulatedRobot(load_robot("bench1"))
    put(world, drive_mode=1)
    put(world, position_p_gain=800, torque_enable=1)
    world.advance(0.1)
    start = world.firmware.count[0]
    world.firmware.goal[:] = start + 300
    world.advance(3.0)
    assert world.mechanics.angle[0] < -0.3


def test_heat_overload_and_voltage_shut_down():
    """Heat, a stall of two seconds and over-voltage each let the torque go until a reboot."""
    cases = {
        0x04: [Fault("heat", value=50.0)],
        0x20: [Fault("stuck")],
        0x01: [Fault("supply", value=9.0, start=0.5)],
    }
    for bit, faults in cases.items():
        world = started(load_robot("bench1"), faults=faults)
        put(world, goal_position=4000)
        world.advance(4.0)
        servo = world.servos[0]
        assert servo.memory["hardware_error_status"] == bit
        assert not world.firmware.torque_on[0]
        assert servo.flagged(0) == 0x80
        put(world, torque_enable=1)
        assert servo.memory["torque_enable"] == 0
        servo.reboot(world.time)
        assert servo.memory["hardware_error_status"] == 0
        assert servo.flagged(0) == 0


def test_temperature_tends_to_the_power():
    """A winding of i^2 R watts ends `heat` kelvins a watt above the room."""
    masked = {"hinge": {"shutdown": 0}}
    world = started(load_robot("bench1"), faults=[Fault("stuck")], registers=masked)
    put(world, goal_pwm=200, goal_position=4000)
    world.firmware._tau[:] = 0.2
    world.advance(2.0)
    power = R * world.firmware.current[0] ** 2
    assert world.firmware.temperature[0] == pytest.approx(25 + 8.0 * power, rel=0.01)


def test_bus_watchdog_stops_and_locks():
    """Without instructions the watchdog trips, holds the servo, and refuses goals until cleared."""
    world = started(load_robot("bench1"))
    servo = world.servos[0]
    Bus(world).feed(instruction_packet(BROADCAST, 1), 0.0, 1_000_000)
    put(world, bus_watchdog=5, profile_velocity=20, goal_position=4000)
    world.advance(0.09)
    assert servo.memory["bus_watchdog"] == 5
    world.advance(0.3)
    assert servo.memory["bus_watchdog"] == -1
    stopped = world.firmware.trajectory[0][0]
    world.advance(0.5)
    assert world.firmware.trajectory[0][0] == stopped
    assert servo.write(116, struct.pack("<i", 2048), world.time) == 4
    put(world, bus_watchdog=0)
    assert servo.write(116, struct.pack("<i", 2048), world.time) == 0


def test_torque_on_by_goal_update():
    """With bit 3 of the drive mode a goal switches the torque on: a trap that a driver must see."""
    world = EmulatedRobot(load_robot("bench1"))
    put(world, drive_mode=8)
    assert not world.firmware.torque_on[0]
    put(world, goal_position=2100)
    assert world.firmware.torque_on[0]


def test_xl330_slope_limits_the_voltage():
    """The factory's PWM slope of 140 lets the voltage rise by 0.277 V a millisecond."""
    world = EmulatedRobot(load_robot("bench1"), faults=[Fault("stuck")])
    put(world, pwm_slope=140, operating_mode=16, torque_enable=1, goal_pwm=885)
    world.advance(world.time + 0.0095)
    assert world.firmware.pwm[0] / 885 * 5.0 == pytest.approx(10 * 140 * 0.001977, rel=0.02)
