"""Feetech servos over their emulated bus: packets, registers, driver, guard and calibrations."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml

from hardware.calibration import apply_calibration, read_calibration
from hardware.clock import VirtualClock
from hardware.config import ROBOTS, load_robot, make_robot
from hardware.connect import make_driver
from hardware.emulator.faults import Fault
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError, SafetyError, ServoError
from hardware.excite import excite
from hardware.feetech import protocol
from hardware.feetech.bus_client import FeetechClient
from hardware.feetech.driver import FeetechDriver
from hardware.feetech.protocol import Parser, packet, status
from hardware.record import joint_names, record
from hardware.safety import Guard
from hardware.scan import ALL_SPEEDS, scan
from hardware.setup import set_up
from hardware.tables import servo_type

MODEL = Path(__file__).with_name("so101.xml")
STEP = 2 * np.pi / 4096  # rad, a count


def shells_of(port: LoopbackPort) -> Any:
    """Return the emulated servos behind a port."""
    bus: Any = port._bus
    return bus.shells


def arm(**changes):
    """Return the SO-101 with our own small model."""
    return replace(load_robot("so101", str(MODEL)), **changes)


class Rig:
    """An emulated arm, its port, driver and guard, connected."""

    def __init__(self, robot=None, faults=(), prepare=None) -> None:
        self.robot = robot or arm()
        self.world = EmulatedRobot(self.robot, faults=faults)
        self.clock = VirtualClock()
        self.port = LoopbackPort(self.world, self.clock)
        self.shells = shells_of(self.port)
        if prepare is not None:
            prepare(self.shells)
        self.driver = FeetechDriver(self.robot, self.port, self.clock)
        self.driver.connect()
        self.driver.configure()
        self.guard = Guard(self.driver)

    @property
    def powered(self) -> list[bool]:
        """Which servos have torque."""
        return self.world.firmware.torque_on.tolist()


def test_packets_are_the_makers():
    """What the SDK of the maker sends is what is sent here, byte for byte, and sums agree."""
    sdk = pytest.importorskip("scservo_sdk")

    class Wire:
        is_using, sent = False, b""

        def clearPort(self):
            """Do nothing."""

        def setPacketTimeout(self, length):
            """Do nothing."""

        def writePort(self, data):
            """Keep the bytes."""
            self.sent = bytes(data)
            return len(data)

    wire, handler = Wire(), sdk.PacketHandler(0)
    handler.readTx(wire, 3, 56, 2)
    assert wire.sent == packet(3, protocol.READ, bytes([56, 2]))
    wire.is_using = False
    handler.writeTxOnly(wire, 9, 42, 2, [0x34, 0x12])
    assert wire.sent == packet(9, protocol.WRITE, bytes([42, 0x34, 0x12]))
    wire.is_using = False
    handler.syncWriteTxOnly(wire, 42, 2, [1, 5, 6, 2, 7, 8], 6)
    assert wire.sent == packet(0xFE, protocol.SYNC_WRITE, bytes([42, 2, 1, 5, 6, 2, 7, 8]))
    assert packet(1, protocol.READ, bytes([56, 2])).hex() == "ffff0104023802be"


def test_damaged_and_noisy_streams():
    """Noise, false headers and damage cost only what they touch; whole packets come through."""
    good = status(2, 0, b"\x00\x08")
    found = Parser().feed(b"\x12\xff\x00" + good + b"\xff" + good)
    assert [p.ok for p in found] == [True, True]
    assert [p.params[1:] for p in found] == [b"\x00\x08"] * 2
    broken = bytearray(good)
    broken[5] ^= 1
    found = Parser().feed(bytes(broken) + good)
    assert [p.ok for p in found][-1]
    assert not found[0].ok
    parser = Parser()
    assert parser.feed(good[:5]) == []
    assert parser.pending == 5
    assert parser.feed(good[5:])[0].ok
    [alarm] = Parser().feed(status(1, 0x20, b""))
    assert alarm.alert and alarm.error == 0


def test_registers_with_a_sign_bit():
    """Numbers are a sign and a size: velocity in bit 15, the offset in bit 11, duty in bit 10."""
    table = servo_type("sts3215").registers
    anchors = {
        "model_number": (3, 2), "id": (5, 1), "homing_offset": (31, 2), "torque_enable": (40, 1),
        "goal_position": (42, 2), "lock": (55, 1), "present_position": (56, 2),
        "present_temperature": (63, 1), "present_current": (69, 2),
    }  # fmt: skip
    assert {name: (table[name].address, table[name].size) for name in anchors} == anchors
    assert table["present_velocity"].encode(-100) == (0x8000 | 100).to_bytes(2, "little")
    assert table["homing_offset"].encode(-85) == (0x0800 | 85).to_bytes(2, "little")
    assert table["present_pwm"].decode((0x0400 | 250).to_bytes(2, "little")) == -250
    for name in ("present_velocity", "homing_offset", "goal_position"):
        assert all(table[name].decode(table[name].encode(n)) == n for n in (-2047, -1, 0, 7, 2047))
    assert table["lock"].eeprom is False
    assert table["operating_mode"].eeprom is True


def test_an_arm_is_driven_and_its_log_agrees_with_the_nominal_model():
    """Ramp and steps over the bus: the model with the declared delay replays them to 3 counts."""
    rig = Rig()
    with rig.guard as guard:
        pose = guard.arm().position
        rng = np.random.default_rng(0)
        log = record(guard, excite(rig.robot, pose, 6.0, ("ramp", "steps"), rng, size=0.3))
    assert rig.powered == [False] * 6
    assert log.column("flag.fresh").min() == 1
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    model.opt.timestep = 0.0005
    data = mujoco.MjData(model)
    joints = joint_names(rig.robot)
    track, due = [], log.time + rig.robot.command_delay
    for stamp in log.column("stamp.elbow_flex"):
        while data.time < stamp:
            row = max(int(np.searchsorted(due, data.time, side="right")) - 1, 0)
            data.ctrl[:] = [log.column(f"ctrl.{name}")[row] for name in rig.robot.names]
            mujoco.mj_step(model, data)
        track.append([data.joint(name).qpos[0] for name in joints])
    measured = np.stack([log.column(f"qpos.{name}") for name in joints], axis=1)
    gap = np.sqrt(np.mean((np.array(track) - measured) ** 2, axis=0))
    assert gap.max() < 3 * STEP
    assert np.ptp(measured, axis=0).min() > 0.05


@pytest.mark.parametrize("offset", [2047, -1500])
def test_a_homing_offset_in_the_servo_changes_no_angle(offset):
    """What LeRobot wrote into a servo is read and taken into account, for readings and goals."""

    def prepare(shells) -> None:
        shells[2]["homing_offset"] = offset
        shells[2]._kept = bytes(shells[2].data[:40])

    rig = Rig(prepare=prepare)
    reported = rig.driver.read().count[2]
    assert reported == (2048 - offset) % 4096
    with rig.guard as guard:
        guard.arm()
        goal = np.array([0, 0, 0.4, 0, 0, 0])
        guard.move_to(goal, speed=1.0)
        rig.clock.sleep_until(rig.clock.now() + 0.5)
        assert guard.read().position[2] == pytest.approx(0.4, abs=0.06)
        assert rig.world.mechanics.angle[2] == pytest.approx(0.4, abs=0.06)


def test_lerobots_calibration_of_a_feetech_servo(tmp_path):
    """A worked example: encoder at 1000 in the middle, travel 400 to 1600.

    Feetech's servos take the offset off: LeRobot writes 1000 - 2047 = -1047, and records the ends
    as 400 + 1047 = 1447 and 1600 + 1047 = 2647. The driver reads the offset from the servo, so that
    the angle 0 is where the encoder is at 1000, whatever the servo reports.
    """
    robot = arm()
    entry = {"drive_mode": 0, "homing_offset": -1047, "range_min": 1447, "range_max": 2647}
    table = {servo.name: {"id": servo.id, **entry} for servo in robot.servos}
    path = tmp_path / "so101.json"
    path.write_text(json.dumps(table))
    servo = apply_calibration(robot, read_calibration(path)).servos[1]
    assert servo.zero == 1000
    assert [servo.count(angle) for angle in servo.position] == [400, 1600]


def test_torque_goes_off_on_every_way_out():
    """An exception, a lost cable that comes back, and the guard's stop leave no servo powered."""
    rig = Rig()
    with pytest.raises(ZeroDivisionError), rig.guard:
        rig.guard.arm()
        assert rig.powered == [True] * 6
        raise ZeroDivisionError
    assert rig.powered == [False] * 6
    rig = Rig(faults=[Fault("stuck", start=1.0, servo=2)])
    rig.clock.sleep_until(0.9)
    with rig.guard as guard:
        guard.arm()
        with pytest.raises(SafetyError, match=r"shoulder_lift is at .* it is stuck"):
            record(guard, np.tile(np.arange(200)[:, None] * 0.02, 6))
    assert rig.powered == [False] * 6


def test_answers_that_cannot_be_true_are_refused():
    """A jump that passes the sum, and lost answers: the last value is held, and marked old."""
    rig = Rig(faults=[Fault("drop", start=2.0, stop=2.5, servo=3, probability=0.5)])
    rig.driver.read()
    shell = rig.shells[0]
    read = shell.read

    def jumped(address: int, size: int) -> bytes:
        data = bytearray(read(address, size))
        if address == 56:
            data[0:2] = (3000).to_bytes(2, "little")
        return bytes(data)

    shell.read = jumped
    rig.clock.sleep_until(rig.clock.now() + 0.02)
    reading = rig.driver.read()
    assert not reading.fresh[0]
    assert reading.fresh[1:].all()
    assert abs(reading.position[0]) < 0.05
    assert rig.driver.bus_client.counters[1].corrupt == 2  # and once more when asked again
    shell.read = read
    rig.clock.sleep_until(2.01)
    held = [rig.driver.read().fresh[2] for _ in range(10)]
    assert rig.driver.bus_client.counters[3].timeout > 0
    assert any(held)


def test_hardware_errors_stop_the_arm():
    """A servo that shuts itself down flags its answers; the guard names the reason."""
    rig = Rig()
    with rig.guard as guard:
        guard.arm()
        rig.world.firmware.shut_down(3, 0x20)
        with pytest.raises(SafetyError, match="wrist_flex reports 'overload'"):
            record(guard, np.zeros((20, 6)))
    assert rig.powered == [False] * 6


def test_what_the_servo_itself_does():
    """Goals are clamped to its limits, its EEPROM is kept only without the lock, limits hold."""
    rig = Rig()
    client, servo = rig.driver.bus_client, rig.robot.servos[0]
    rig.driver.write_register(servo, "max_position_limit", 2100)
    client.write(1, 42, (3000).to_bytes(2, "little"))
    assert rig.driver.read_register(servo, "goal_position") == 2100
    rig.world.servos[0].reboot(rig.world.time)  # its supply goes and comes
    rig.clock.sleep_until(rig.clock.now() + 0.5)
    assert rig.driver.read_register(servo, "max_position_limit") == 4095
    rig.driver.write_register(servo, "lock", 0)
    rig.driver.write_register(servo, "max_position_limit", 2100)
    rig.world.servos[0].reboot(rig.clock.now())
    rig.clock.sleep_until(rig.clock.now() + 0.5)
    assert rig.driver.read_register(servo, "max_position_limit") == 2100
    rig.driver.write_register(servo, "torque_limit", 100)
    assert abs(rig.world.servos[0].memory["goal_pwm"]) == 100


def test_factory_servos_become_an_arm(monkeypatch):
    """Setup asks for each, gives it its ID, and leaves a speed of 1 Mbit/s as it is."""

    def factory(shells) -> None:
        for shell in shells:
            shell["id"], shell["return_delay_time"] = 1, 250
            shell._kept = bytes(shell.data[:40])

    monkeypatch.setitem(ALL_SPEEDS, "feetech", (1_000_000, 500_000))
    robot = arm()
    world, clock = EmulatedRobot(robot), VirtualClock()
    port = LoopbackPort(world, clock)
    shells = shells_of(port)
    factory(shells)
    asked: list[str] = []

    def ask(prompt: str, meanwhile: object = None) -> str:
        if "connect all" in prompt:
            for core in world.servos:
                core.silent_until = 0.0
            return ""
        if "missing" in prompt:
            alone = len(asked)
            asked.append(prompt)
            for i, core in enumerate(world.servos):
                core.silent_until = 0.0 if i == alone else np.inf
            return ""
        return "y"

    for core in world.servos:
        core.silent_until = np.inf
    client, told = FeetechClient(port, clock, 0.001), []
    set_up(robot, client, ask, told.append)
    assert len(asked) == 6
    assert all(core.silent_until == 0.0 for core in world.servos)  # it asked for all at the end
    assert [shell["id"] for shell in shells] == [1, 2, 3, 4, 5, 6]
    assert [shell["lock"] for shell in shells] == [1] * 6
    assert all(shell._kept[5] == i + 1 for i, shell in enumerate(shells))
    assert any("return_delay_time 250 -> 0" in line for line in told)
    assert [(f.baud, f.id, f.model) for f in scan(client, "feetech")] == [
        (1_000_000, n, "sts3215") for n in range(1, 7)
    ]


def test_what_an_arm_cannot_be():
    """No watchdog, no mixed bus, no model of our own: each refused with what to do."""
    with pytest.raises(RobotError, match=r"give robot\.model=PATH"):
        load_robot("so101")
    assert load_robot("so101", needs_model=False).names[5] == "gripper"
    data = yaml.safe_load((ROBOTS / "so101.yaml").read_text()) | {"model": str(MODEL)}
    with pytest.raises(RobotError, match="Feetech servos have none: give 0"):
        make_robot(data | {"watchdog": 0.1})
    data["servos"]["gripper"] = data["servos"]["gripper"] | {
        "model": "xl330-m288",
        "supply": {"voltage": 5.0},
    }
    data["registers"] = {}
    with pytest.raises(RobotError, match="on one bus; each has its own"):
        make_robot(data)
    with pytest.raises(ServoError, match="no watchdog"):
        Rig().driver.set_watchdogs(5)
    assert isinstance(make_driver(arm()), FeetechDriver)
