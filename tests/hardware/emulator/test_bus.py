"""The emulated bus answers as the manual says, to the SDK's own code and to raw bytes."""

import itertools
import struct

import dynamixel_sdk as sdk
import numpy as np
import pytest

from hardware import protocol
from hardware.clock import VirtualClock
from hardware.config import load_robot
from hardware.emulator.bus import Bus
from hardware.emulator.faults import Fault
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import EmulatedRobot
from hardware.protocol import Parser, instruction_packet
from tests.hardware.emulator.host import BAUD, Host


def test_ping_answers_as_published(chain):
    """An XM430-W210 of firmware 38 answers the manual's ping with the manual's bytes."""
    world = EmulatedRobot(load_robot("bench1"), registers={"hinge": {"model_number": 1030}})
    world.servos[0].memory["model_number"] = 1030
    world.servos[0].memory["firmware_version"] = 38
    ping = bytes.fromhex("FF FF FD 00 01 03 00 01 19 4E")
    ((_, answer),) = Bus(world).feed(ping, 0.0, BAUD)
    assert answer == bytes.fromhex("FF FF FD 00 01 07 00 55 00 06 04 26 65 5D")


def test_read_answers_as_published(host):
    """Reading a present position of 166 gives the manual's bytes."""
    host.world.firmware.base[:] = 166 - 2048
    request = bytes.fromhex("FF FF FD 00 01 07 00 02 84 00 04 00 1D 15")
    ((_, answer),) = host.bus.feed(request, 0.0, BAUD)
    assert answer == bytes.fromhex("FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0")


def test_write_read_and_access_rules(host):
    """RAM and EEPROM are written and read; read-only, torque and ranges are respected."""
    assert host.write(1, "position_p_gain", 800) == 0
    assert host.read(1, "position_p_gain") == 800
    assert host.write(1, "present_position", 1) == protocol.NO_ACCESS
    assert host.write(1, "operating_mode", 4) == 0
    assert host.write(1, "operating_mode", 2) == protocol.BAD_RANGE
    assert host.write(1, "operating_mode", 3) == 0
    assert host.write(1, "torque_enable", 1) == 0
    assert host.write(1, "operating_mode", 4) == protocol.NO_ACCESS
    assert host.write(1, "goal_position", 4096) == protocol.BAD_LIMIT
    assert host.write(1, "goal_position", -1) == protocol.BAD_LIMIT
    assert host.write(1, "goal_pwm", 886) == protocol.BAD_LIMIT
    assert host.read(1, "operating_mode") == 3
    (packet,) = host.send(1, protocol.READ, struct.pack("<HH", 60000, 4))
    assert packet.error == protocol.NO_ACCESS
    (packet,) = host.send(1, protocol.READ, b"\x00")
    assert packet.error == protocol.BAD_LENGTH
    (packet,) = host.send(1, 0x77)
    assert packet.error == protocol.UNKNOWN_INSTRUCTION


def test_reg_write_waits_for_action(three):
    """A registered write happens when a broadcast action comes, on all servos at once."""
    for number in (1, 2):
        body = struct.pack("<HB", 65, 1)
        (packet,) = three.send(number, protocol.REG_WRITE, body)
        assert packet.error == 0
        assert three.read(number, "registered_instruction") == 1
        assert three.read(number, "led") == 0
    assert three.send(protocol.BROADCAST, protocol.ACTION) == []
    assert [three.read(n, "led") for n in (1, 2, 3)] == [1, 1, 0]
    assert three.read(1, "registered_instruction") == 0


def test_reboot_forgets_ram_and_is_silent_for_a_while(host):
    """A reboot answers first, then nothing for 0.2 s; gains and torque are fresh, EEPROM stays."""
    host.write(1, "homing_offset", 7)
    host.write(1, "position_p_gain", 99)
    host.write(1, "torque_enable", 1)
    (packet,) = host.send(1, protocol.REBOOT)
    assert packet.error == 0
    assert host.send(1, protocol.PING) == []
    host.time += 0.25
    assert host.read(1, "homing_offset") == 7
    assert host.read(1, "position_p_gain") == 400
    assert host.read(1, "torque_enable") == 0


@pytest.mark.parametrize(("mode", "number", "baud"), [(0xFF, 1, 1), (1, 9, 1), (2, 9, 3)])
def test_factory_reset(mode, number, baud):
    """A factory reset keeps nothing, the ID, or ID and baud rate."""
    world = EmulatedRobot(load_robot("bench1"), registers={"hinge": {"id": 9}})
    host = Host(world)
    host.write(9, "drive_mode", 4)
    host.send(9, protocol.FACTORY_RESET, bytes([mode]))
    memory = world.servos[0].memory
    assert (memory["id"], memory["baud_rate"], memory["drive_mode"]) == (number, baud, 0)


def test_clear_brings_whole_turns_back(host):
    """Clear takes whole turns off the present position."""
    host.write(1, "operating_mode", 4)
    host.world.firmware.base[:] = 3 * 4096
    host.time += 0.01
    assert host.read(1, "present_position") == 2048 + 3 * 4096
    (packet,) = host.send(1, protocol.CLEAR, bytes([1, 0x44, 0x58, 0x4C, 0x22]), wait=0.01)
    assert packet.error == 0
    assert host.read(1, "present_position") == 2048


def test_indirect_registers_read_and_write_elsewhere(host):
    """Indirect data bytes are those that their indirect addresses name."""
    for i, address in enumerate((132, 133, 65), 1):
        assert host.write(1, f"indirect_address_{i}", address) == 0
    start = host.world.servos[0].memory.kind.registers["indirect_data_1"].address
    (packet,) = host.send(1, protocol.READ, struct.pack("<HH", start, 2))
    assert int.from_bytes(packet.params[1:], "little") == 2048
    host.send(1, protocol.WRITE, struct.pack("<HB", start + 2, 1))
    assert host.read(1, "led") == 1
    (packet,) = host.send(1, protocol.WRITE, struct.pack("<HB", start, 1))
    assert packet.error == protocol.NO_ACCESS


@pytest.mark.parametrize(("level", "expected"), [(0, (1, 0, 0)), (1, (1, 1, 0)), (2, (1, 1, 1))])
def test_status_return_level(host, level, expected):
    """Level 0 answers pings, 1 also reads, 2 everything."""
    host.write(1, "status_return_level", level)
    counts = (
        len(host.send(1, protocol.PING)),
        len(host.send(1, protocol.READ, struct.pack("<HH", 65, 1))),
        len(host.send(1, protocol.WRITE, struct.pack("<HB", 65, 1))),
    )
    assert counts == expected
    assert host.world.servos[0].memory["led"] == 1


def test_sync_and_bulk_answers(three):
    """Sync and bulk reads answer in the order asked, fast ones in one packet with a CRC each."""
    sync = struct.pack("<HH", 132, 4) + bytes([3, 1, 2])
    assert [p.id for p in three.send(254, protocol.SYNC_READ, sync)] == [3, 1, 2]
    bulk = b"".join(struct.pack("<BHH", n, 132, n) for n in (2, 3))
    assert [len(p.params) for p in three.send(254, protocol.BULK_READ, bulk)] == [3, 4]
    (packet,) = three.send(254, protocol.FAST_SYNC_READ, sync)
    assert packet.ok
    assert packet.raw[9] == 3
    assert packet.raw[8 + 8 + 1] == 1
    (packet,) = three.send(254, protocol.FAST_BULK_READ, bulk)
    assert packet.ok
    assert len(packet.raw) == 8 + (4 + 2) + (4 + 3)


def test_sync_and_bulk_write(three):
    """Sync and bulk writes reach every servo named, silently."""
    body = struct.pack("<HH", 116, 4) + b"".join(struct.pack("<Bi", n, 2000 + n) for n in (1, 3))
    assert three.send(254, protocol.SYNC_WRITE, body) == []
    assert [three.read(n, "goal_position") for n in (1, 2, 3)] == [2001, 2048, 2003]
    body = struct.pack("<BHHB", 2, 65, 1, 1) + struct.pack("<BHHH", 3, 84, 2, 321)
    assert three.send(254, protocol.BULK_WRITE, body) == []
    assert three.read(2, "led") == 1
    assert three.read(3, "position_p_gain") == 321


def test_a_missing_servo_ends_the_chain(three):
    """Servos after a missing one do not answer; a fast answer ends before its length."""
    sync = struct.pack("<HH", 132, 4) + bytes([1, 9, 2])
    assert [p.id for p in three.send(254, protocol.SYNC_READ, sync)] == [1]
    assert three.send(254, protocol.FAST_SYNC_READ, sync) == []


def test_crc_error_is_answered(host):
    """A damaged instruction to a servo is answered with the CRC error and no data."""
    data = bytearray(instruction_packet(1, protocol.READ, struct.pack("<HH", 132, 4)))
    data[8] ^= 1
    ((_, answer),) = host.bus.feed(bytes(data), 0.0, BAUD)
    (packet,) = Parser().feed(answer)
    assert packet.error == protocol.BAD_CRC
    assert packet.params == bytes([protocol.BAD_CRC])


def test_wrong_baud_is_not_heard(host):
    """A host of another speed gets no answer."""
    assert host.bus.feed(instruction_packet(1, protocol.PING), 0.0, 57600) == []


def test_the_sdk_works_unchanged(three):
    """The SDK's own handlers ping, read, write and read in groups over the loopback."""
    port = LoopbackPort(three.world, VirtualClock())
    assert port.openPort()
    assert port.setBaudRate(BAUD)
    handler = sdk.PacketHandler(2.0)
    assert handler.ping(port, 2) == (1200, 0, 0)
    found, result = handler.broadcastPing(port)
    assert result == 0
    assert found == {n: [1200, 52] for n in (1, 2, 3)}
    assert handler.write4ByteTxRx(port, 1, 116, 1500) == (0, 0)
    group = sdk.GroupSyncRead(port, handler, 116, 4)
    for n in (1, 2, 3):
        group.addParam(n)
    for read in (group.txRxPacket, group.fastSyncRead):
        assert read() == 0
        assert [group.getData(n, 116, 4) for n in (1, 2, 3)] == [1500, 2048, 2048]
    assert handler.reboot(port, 1)[0] == 0
    before = port.clock.now()
    assert handler.ping(port, 1)[1] == sdk.COMM_RX_TIMEOUT
    assert port.clock.now() - before == pytest.approx(0.034, abs=0.002)


@pytest.mark.parametrize(
    ("baud", "delay", "latency", "count", "plain", "fast"),
    [
        (57600, 500e-6, 0.016, 3, 36.4, 33.2),
        (1_000_000, 500e-6, 0.001, 8, 7.4, 3.5),
        (1_000_000, 0.0, 0.001, 12, 4.5, 3.8),
        (3_000_000, 0.0, 0.001, 12, 2.2, 1.9),
    ],
)
def test_a_cycle_takes_the_time_of_the_wire(chain, baud, delay, latency, count, plain, fast):
    """Writing all goals and reading 10 bytes of each takes what bytes, delays and latency add to.

    The expected times [ms] are computed from 10 bits a byte; turn-rounds of 50 us come on top.
    """
    settings = {"baud": baud, "return_delay": delay, "latency": latency}
    robot = chain(count, bus=settings)
    numbers = bytes(range(1, count + 1))
    goals = struct.pack("<HH", 116, 4) + b"".join(struct.pack("<Bi", n, 2048) for n in numbers)
    request = struct.pack("<HH", 126, 10) + numbers
    for instruction, expected, turns in (
        (protocol.SYNC_READ, plain, count),
        (protocol.FAST_SYNC_READ, fast, 1),
    ):
        bus, spans = Bus(EmulatedRobot(robot)), []
        for k in range(20):
            start = 1.0 + 0.2 * k
            bus.feed(instruction_packet(254, protocol.SYNC_WRITE, goals), start, baud)
            read = instruction_packet(254, instruction, request)
            ((arrival, _),) = bus.feed(read, start, baud)[-1:]
            spans.append(1e3 * (arrival - start))
        wire = expected - 1e3 * latency
        assert min(spans) >= wire - 0.1
        assert max(spans) <= wire + 0.05 * turns + 1e3 * latency + 0.1
        if baud == 1_000_000 and delay == 0:
            assert max(spans) < 10.0


def test_later_servos_of_a_chain_are_seen_later(chain):
    """Twelve falling pendulums that are alike read differently: each is sampled in its turn."""
    world = EmulatedRobot(chain(12))
    world.mechanics.data.qpos[world.mechanics.qpos] = 1.5
    numbers = struct.pack("<HH", 132, 4) + bytes(range(1, 13))
    request, bus = instruction_packet(254, protocol.SYNC_READ, numbers), Bus(world)
    bus.feed(request, 0.15, BAUD)
    data = b"".join(piece for _, piece in bus.feed(request, 0.16, BAUD))
    values = [int.from_bytes(p.params[1:], "little", signed=True) for p in Parser().feed(data)]
    assert len(values) == 12
    assert all(b <= a for a, b in itertools.pairwise(values))
    assert values[0] - values[-1] >= 3


def test_same_seed_same_bytes():
    """Two worlds of one seed give the same bytes at the same times; another seed does not."""

    def run(seed: int) -> list[tuple[float, bytes]]:
        faults = [Fault("drop", probability=0.1), Fault("noise", probability=0.2, value=3)]
        bus = Bus(EmulatedRobot(load_robot("bench1"), seed=seed, faults=faults))
        request = instruction_packet(1, protocol.READ, struct.pack("<HH", 132, 4))
        found = []
        for k in range(60):
            found += bus.feed(request, 0.02 * k, BAUD)
        return found

    assert run(3) == run(3)
    assert run(3) != run(4)


def test_any_bytes_do_no_harm(host):
    """Random and mutated bytes from the host leave the bus answering."""
    rng = np.random.default_rng(5)
    good = instruction_packet(1, protocol.READ, struct.pack("<HH", 132, 4))
    for _ in range(3000):
        if rng.random() < 0.5:
            data = rng.bytes(int(rng.integers(1, 40)))
        else:
            changed = bytearray(good)
            changed[int(rng.integers(0, len(good)))] = int(rng.integers(0, 256))
            data = bytes(changed)
        host.bus.feed(data, host.time, BAUD)
        host.time += 0.001
    host.time += 0.5
    assert host.send(1, protocol.PING)[0].error == 0
