"""The bus client survives what the SDK does not, and never takes a wrong answer for a right one."""

import socket
import struct
from itertools import product
from typing import Any

import dynamixel_sdk as sdk
import numpy as np
import pytest

from hardware.bus_client import BusClient
from hardware.clock import RealClock, VirtualClock
from hardware.emulator.faults import Fault
from hardware.emulator.loopback import LoopbackPort
from hardware.emulator.world import EmulatedRobot
from hardware.errors import SerialPortError

BAUD = 1_000_000


@pytest.fixture
def connect(chain):
    """Return a function that opens a client to three servos with faults."""

    def make(*faults: Fault, count: int = 3, **kwargs) -> BusClient:
        port = LoopbackPort(EmulatedRobot(chain(count), faults=faults, **kwargs), VirtualClock())
        client = BusClient(port, port.clock, latency=0.001, return_delay=0.0)
        client.open(BAUD)
        return client

    return make


def bare(client: BusClient) -> sdk.GroupSyncRead:
    """Return the SDK's own group read over the same port."""
    group = sdk.GroupSyncRead(client.port, sdk.PacketHandler(2.0), 132, 4)
    for number in (1, 2, 3):
        group.addParam(number)
    return group


def positions(replies) -> dict[int, int]:
    """Return the positions in replies to a read of 4 bytes."""
    return {n: int.from_bytes(r.data, "little", signed=True) for n, r in replies.items()}


def test_everything_works_without_faults(connect):
    """Pings, reads, writes and group reads give what the servos hold."""
    client = connect()
    assert client.broadcast_ping() == {n: (1200, 52) for n in (1, 2, 3)}
    assert len(client.ping(2)) == 1
    assert client.ping(9) == []
    assert client.write(2, 84, struct.pack("<H", 77)).error == 0
    assert client.read(2, 84, 2).data == struct.pack("<H", 77)
    for fast in (False, True):
        assert positions(client.sync_read(132, 4, [1, 2, 3], fast)) == {1: 2048, 2: 2048, 3: 2048}


def test_defect_1_late_status_in_a_fast_read(connect):
    """A late status before a fast answer raises IndexError in the SDK; here it is left out."""
    client = connect()
    group = bare(client)
    client.port.writePort(bytes.fromhex("FF FF FD 00 01 07 00 02 84 00 04 00 1D 15"))
    with pytest.raises(IndexError):
        group.fastSyncRead()
    client = connect()
    client.port.writePort(bytes.fromhex("FF FF FD 00 01 07 00 02 84 00 04 00 1D 15"))
    assert positions(client.sync_read(132, 4, [1, 2, 3], fast=True)) == {1: 2048, 2: 2048, 3: 2048}
    assert client.counters[1].foreign == 1


def test_defect_2_status_without_data(connect):
    """An error status without parameters crashes the SDK's reads; here it is a missing answer."""
    broken = Fault("corrupt_command", value=8, count=1)
    client = connect(broken)
    with pytest.raises(IndexError):
        sdk.PacketHandler(2.0).read4ByteTxRx(client.port, 1, 132)
    client = connect(broken)
    assert client.read(1, 132, 4) is None
    assert client.counters[1].short == 1
    assert client.counters[1].error == 1
    assert client.read(1, 132, 4).data == struct.pack("<i", 2048)


def test_defect_3_alert_bit_in_group_reads(connect):
    """The SDK's group read says nothing of a servo in shutdown; here every reply shows it."""
    client = connect()
    world = client.port.world
    world.firmware.shut_down(1, 0x20)
    assert bare(client).txRxPacket() == sdk.COMM_SUCCESS
    for fast in (False, True):
        replies = client.sync_read(132, 4, [1, 2, 3], fast)
        assert [replies[n].alert for n in (1, 2, 3)] == [False, True, False]
    assert client.counters[2].alert == 2


def test_defect_4_unplugged_cable(connect):
    """The SDK's port stays busy for ever after EIO; here it works again once it is back."""
    client = connect()
    client.port.unplugged = True
    handler = sdk.PacketHandler(2.0)
    with pytest.raises(OSError, match="Input/output"):
        handler.ping(client.port, 1)
    client.port.unplugged = False
    assert handler.ping(client.port, 1)[1] == sdk.COMM_PORT_BUSY
    client.port.unplugged = True
    with pytest.raises(SerialPortError, match=r"the port is gone.*is the cable in\?"):
        client.read(1, 132, 4)
    client.port.unplugged = False
    assert client.read(1, 132, 4) is not None


def test_defect_5_duplicate_before_the_answer(connect):
    """An old answer in the buffer, taken for the new by the SDK, is drained after a failure."""
    client = connect(Fault("late", servo=1, value=0.004, count=1))
    assert client.read(1, 132, 4) is None
    client.port.world.firmware.base[0] = 500
    client.clock.sleep_until(client.clock.now() + 0.02)
    assert client.read(1, 132, 4).data == struct.pack("<i", 2548)
    assert client.counters[1].timeout == 1


def test_defect_6_missing_servo_is_missing(connect):
    """Where the SDK gives position 0 for a servo that is silent, here it is not in the result."""
    client = connect(Fault("drop", servo=2))
    group = bare(client)
    assert group.txRxPacket() == sdk.COMM_RX_TIMEOUT
    assert group.getData(2, 132, 4) == 0
    replies = client.sync_read(132, 4, [1, 2, 3], fast=False)
    assert set(replies) == {1, 3}
    assert client.counters[2].timeout == 1


@pytest.mark.parametrize(
    ("fault", "value"), [*product(["corrupt"], range(-15, 15)), *product(["truncate"], range(15))]
)
def test_a_damaged_or_cut_answer_is_never_a_value(connect, fault, value):
    """With any one byte inverted, or cut anywhere, it is left out; the next request is clean."""
    client = connect(Fault(fault, servo=1, value=value, count=1))
    assert client.read(1, 132, 4) is None
    assert client.read(1, 132, 4).data == struct.pack("<i", 2048)


def test_foreign_and_noisy_answers(connect):
    """Another servo's answer is refused, noise in front of the right one is skipped."""
    client = connect(Fault("foreign", servo=1, value=7, count=1))
    assert client.read(1, 132, 4) is None
    assert client.counters[7].foreign == 1
    client = connect(Fault("noise", value=9))
    assert len(client.sync_read(132, 4, [1, 2, 3], fast=False)) == 3


def test_servos_that_share_an_id_are_heard_twice(connect):
    """A ping hears both servos of one ID."""
    client = connect(registers={"hinge2": {"id": 1}})
    assert len(client.ping(1)) == 2


def test_random_answers_never_become_values(connect):
    """Over 3,000 reads with mutated answers, only the true value is ever returned."""
    client = connect(count=1)
    world = client.port.world
    rng = np.random.default_rng(8)
    changed = 0

    def outgoing(data: bytes, servo: int, now: float) -> list[tuple[float, bytes]]:
        nonlocal changed
        kind = rng.integers(0, 4)
        if kind == 0:
            return [(0.0, data)]
        changed += 1
        mutated = bytearray(data)
        for _flip in range(int(rng.integers(1, 3))):
            mutated[int(rng.integers(0, len(data)))] ^= 1 << int(rng.integers(0, 8))
        return [(0.0, bytes(mutated) if kind < 3 else rng.bytes(20))]

    world.faults.outgoing = outgoing
    values = [client.read(1, 132, 4) for _ in range(3000)]
    assert changed > 2000
    good = [reply.data for reply in values if reply is not None]
    assert len(good) >= 600
    assert set(good) == {struct.pack("<i", 2048)}


def test_unknown_port_and_speed():
    """A port that is not there, and a speed that the SDK lacks, are one sentence each."""
    port = sdk.PortHandler("/dev/no-such-port")
    client = BusClient(port, VirtualClock(), latency=0.001)
    with pytest.raises(SerialPortError, match="no such port; is the cable in"):
        client.open(BAUD)
    with pytest.raises(SerialPortError, match="cannot run at 4500000 bits/s"):
        client.open(4_500_000)


def says(data: bytes) -> Any:
    """Return a port on which these bytes come whenever it is read."""
    port: Any = sdk.PortHandler("nothing")
    port.is_open = True
    port.ser, port.far_end = socket.socketpair()  # silent
    port.clearPort, port.writePort, port.readPort = lambda: None, len, lambda _: data
    return port


def test_setting_the_date_does_no_harm(monkeypatch):
    """A wall clock that runs back, or leaps, neither hangs a read nor cuts it short."""
    stopped = says(b"")
    wall = iter(range(10**9, 0, -(10**5)))
    monkeypatch.setattr(stopped, "getCurrentTime", lambda: next(wall))
    clock = RealClock()
    client = BusClient(stopped, clock, latency=0.001)
    began = clock.now()
    assert client.read(1, 132, 4) is None
    assert 0.01 < clock.now() - began < 1.0


def test_a_port_that_floods_is_left_in_time():
    """Bytes that never end neither hang a read nor a scan."""
    flood = says(b"\x55" * 64)
    clock = RealClock()
    client = BusClient(flood, clock, latency=0.001)
    began = clock.now()
    assert client.read(1, 132, 4) is None
    assert client.ping(1) == []
    assert client.broadcast_ping() == {}
    assert clock.now() - began < 3.0
