"""An emulated control table refuses, resets and keeps what the manual says."""

import struct

import pytest

from hardware import protocol
from hardware.config import load_robot
from hardware.emulator.world import EmulatedRobot
from hardware.protocol import instruction_packet
from tests.hardware.emulator.host import BAUD, Host

BACK_UP, RESTORE = b"\x01CTRL", b"\x02CTRL"


def error_of(host: Host, address: int, data: bytes) -> int:
    """Write bytes at an address and return the error."""
    (packet,) = host.send(1, protocol.WRITE, struct.pack("<H", address) + data)
    return packet.error


def test_short_writes(host):
    """Bytes that end within a register are too short; bytes that begin within one have no place.

    The manual's example of the data length error: two bytes of an item of four.
    """
    assert error_of(host, 116, bytes(2)) == protocol.BAD_LENGTH
    assert error_of(host, 112, bytes(6)) == protocol.BAD_LENGTH
    assert error_of(host, 117, bytes(3)) == protocol.NO_ACCESS
    assert host.read(1, "goal_position") == 2048
    assert error_of(host, 112, bytes(4) + struct.pack("<i", 2000)) == 0
    assert host.read(1, "goal_position") == 2000


def test_the_answer_to_a_short_write(host):
    """Two bytes into Goal Position are answered with error 5, byte for byte."""
    short = instruction_packet(1, protocol.WRITE, struct.pack("<HH", 116, 512))
    ((_, answer),) = host.bus.feed(short, 0.0, BAUD)
    assert answer[:9] == bytes.fromhex("FF FF FD 00 01 04 00 55 05")


def test_short_writes_through_indirect_data(host):
    """Half a register by way of indirect data is too short as well."""
    for i, address in enumerate((116, 117, 118, 119), 1):
        host.set(**{f"indirect_address_{i}": address})
    start = host.world.servos[0].memory.kind.registers["indirect_data_1"].address
    assert error_of(host, start, bytes(2)) == protocol.BAD_LENGTH
    assert error_of(host, start, struct.pack("<i", 2100)) == 0
    assert host.read(1, "goal_position") == 2100


def test_ranges_and_limits(host):
    """Beyond a fixed range is error 4, beyond the limit that another register sets is error 6."""
    for name, low, high in [
        ("current_limit", 0, 1750),
        ("velocity_limit", 0, 2047),
        ("max_voltage_limit", 31, 70),
        ("min_voltage_limit", 31, 70),
        ("baud_rate", 0, 6),
        ("startup_configuration", 0, 3),
    ]:
        assert host.write(1, name, high + 1) == protocol.BAD_RANGE, name
        if low:
            assert host.write(1, name, low - 1) == protocol.BAD_RANGE, name
    host.set(velocity_limit=100, current_limit=200, pwm_limit=300, max_position_limit=3000)
    for name, limit in [("goal_velocity", 100), ("goal_current", 200), ("goal_pwm", 300)]:
        assert host.write(1, name, limit) == 0
        assert host.write(1, name, limit + 1) == protocol.BAD_LIMIT
        assert host.write(1, name, -limit - 1) == protocol.BAD_LIMIT
    assert host.write(1, "goal_position", 3001) == protocol.BAD_LIMIT
    host.set(operating_mode=4)
    assert host.write(1, "goal_position", -1_048_575) == 0
    assert host.write(1, "goal_position", 1_048_576) == protocol.BAD_RANGE


def test_ranges_of_larger_servos():
    """An XM430's limits go as far as its manual says, and 4.5 Mbit/s is one of its speeds."""
    robot = load_robot("arm6")
    host, number = Host(EmulatedRobot(robot)), robot.servos[1].id
    assert robot.servos[1].model == "xm430-w350"
    limits = {"velocity_limit": 1023, "max_voltage_limit": 160, "current_limit": 1193}
    for name, largest in limits.items():
        assert host.write(number, name, largest) == 0
        assert host.write(number, name, largest + 1) == protocol.BAD_RANGE
    assert host.write(number, "baud_rate", 7) == 0


def test_a_new_operating_mode_resets(host):
    """Another mode resets gains, profile, goal PWM and goal current; the same mode nothing."""
    changed = {"position_p_gain": 99, "velocity_i_gain": 98, "feedforward_1st_gain": 97}
    changed |= {"profile_velocity": 96, "profile_acceleration": 95}
    changed |= {"goal_pwm": 94, "goal_current": 93}
    host.set(**changed)
    host.set(operating_mode=3)
    assert {name: host.read(1, name) for name in changed} == changed
    host.set(operating_mode=1)
    found = [host.read(1, name) for name in changed]
    assert found == [400, 1600, 0, 0, 0, 885, 1750]


def test_goal_pwm_of_pwm_mode_does_not_stay(host):
    """After PWM mode at 100 the extended position mode has all its PWM again."""
    host.set(operating_mode=16, torque_enable=1, goal_pwm=100)
    host.wait(0.1)
    host.set(torque_enable=0, operating_mode=4)
    assert host.read(1, "goal_pwm") == 885
    assert host.world.firmware.control.goal_pwm[0] == 885


def test_backup_and_restore(host):
    """A copy keeps the EEPROM and some RAM; restoring brings the EEPROM back and reboots.

    The RAM of the copy comes back at boot if the startup configuration says so.
    """
    assert host.read(1, "backup_ready") == 0
    (packet,) = host.send(1, protocol.BACKUP, RESTORE)
    assert packet.error == protocol.FAIL
    host.set(torque_enable=1)
    (packet,) = host.send(1, protocol.BACKUP, BACK_UP)
    assert packet.error == protocol.FAIL
    host.set(torque_enable=0, homing_offset=7, position_p_gain=321, led=1)
    (packet,) = host.send(1, protocol.BACKUP, BACK_UP)
    assert (packet.error, host.read(1, "backup_ready")) == (0, 1)
    host.set(homing_offset=8, position_p_gain=111)
    (packet,) = host.send(1, protocol.BACKUP, RESTORE)
    assert packet.error == 0
    assert host.send(1, protocol.PING) == []
    host.wait(0.25)
    assert (host.read(1, "homing_offset"), host.read(1, "position_p_gain")) == (7, 400)
    host.set(startup_configuration=2)
    host.send(1, protocol.REBOOT)
    host.wait(0.25)
    assert (host.read(1, "position_p_gain"), host.read(1, "led")) == (321, 0)
    (packet,) = host.send(1, protocol.BACKUP, b"\x03CTRL")
    assert packet.error == protocol.BAD_RANGE


def test_startup_with_torque(host):
    """With bit 0 of the startup configuration a servo boots powered and holds where it is."""
    host.set(startup_configuration=1)
    host.world.mechanics.data.qpos[host.world.mechanics.qpos] = 0.3
    host.send(1, protocol.REBOOT)
    host.wait(0.5)
    assert host.read(1, "torque_enable") == 1
    assert host.world.mechanics.angle[0] == pytest.approx(0.3, abs=0.1)
    (packet,) = host.send(1, protocol.WRITE, struct.pack("<HB", 11, 4))
    assert packet.error == protocol.NO_ACCESS


def test_indirect_addresses_reach_no_eeprom(host):
    """They take addresses of the RAM alone, from 64 to the table's end."""
    for address in (7, 11, 63, 228, 300):
        assert host.write(1, "indirect_address_1", address) == protocol.BAD_RANGE
    assert host.read(1, "indirect_address_1") == 208
    host.set(indirect_address_1=227)
    host.set(indirect_address_1=64)


def test_settings_that_a_servo_does_not_have(host):
    """Drive Mode has no second servo at the joint; Protocol Type takes the RC protocols too."""
    for mode in (2, 6, 3, 16):
        assert host.write(1, "drive_mode", mode) == protocol.BAD_RANGE
    host.set(drive_mode=13)
    host.set(drive_mode=0)
    for protocol_type in (0, 1, 23):
        assert host.write(1, "protocol_type", protocol_type) == protocol.BAD_RANGE
    host.set(protocol_type=20)
    host.set(secondary_id=253)  # 253 and more: none
