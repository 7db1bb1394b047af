"""Clients that live in our environment, at a device, each at its own time limits.

    python python_client.py sdk DEVICE          # the maker's SDK, with its 34 ms
    python python_client.py rustypot DEVICE
    python python_client.py dxl2 DEVICE         # dynamixel-python
    python python_client.py sts DEVICE          # rustypot at an SO-101

The first three drive three XL330 with the IDs 1 to 3.
"""

from __future__ import annotations

import struct
import sys
import time
from collections.abc import Callable

MODES = [  # mode; address, bytes and value of the goal; address, bytes and range of the answer
    (0, (102, 2, 60), (126, 2, 30, 90)),
    (1, (104, 4, 60), (128, 4, 30, 90)),
    (3, (116, 4, 2348), (132, 4, 2248, 2400)),
    (4, (116, 4, 6500), (132, 4, 6000, 6600)),
    (5, (116, 4, -3000), (132, 4, -3100, -2500)),
    (16, (100, 2, 300), (124, 2, 295, 300)),
]
TIMEOUT = 0.1  # s, what rustypot's examples give


def until(condition: Callable[[], bool]) -> None:
    """Wait until a condition holds, at most 10 s."""
    end = time.monotonic() + 10
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def in_every_mode(read: Callable[[int, int], int], write: Callable[[int, int, int], None]) -> None:
    """Go through all operating modes with what reads and writes registers of servo 1."""
    for mode, goal, (address, size, least, most) in MODES:
        write(64, 1, 0)
        write(11, 1, mode)
        write(64, 1, 1)
        write(*goal)
        until(lambda: least <= read(address, size) <= most)  # noqa: B023
    write(64, 1, 0)


def sdk(device: str) -> None:
    """The maker's SDK: pings, every mode, and group reads plain and fast."""
    import dynamixel_sdk as maker

    port, packets = maker.PortHandler(device), maker.PacketHandler(2.0)
    assert port.openPort() and port.setBaudRate(1_000_000)

    def read(address: int, size: int) -> int:
        data, result, error = packets.readTxRx(port, 1, address, size)
        assert (result, error) == (maker.COMM_SUCCESS, 0)
        return int.from_bytes(bytes(data), "little", signed=True)

    def write(address: int, size: int, value: int) -> None:
        data = list((value % (1 << 8 * size)).to_bytes(size, "little"))
        assert packets.writeTxRx(port, 1, address, size, data) == (maker.COMM_SUCCESS, 0)

    for number in (1, 2, 3):
        assert packets.ping(port, number) == (1200, maker.COMM_SUCCESS, 0)
    in_every_mode(read, write)
    goals = maker.GroupSyncWrite(port, packets, 116, 4)
    places = maker.GroupSyncRead(port, packets, 116, 4)
    for number in (2, 3):
        assert goals.addParam(number, struct.pack("<i", 2000 + number)) and places.addParam(number)
    assert goals.txPacket() == maker.COMM_SUCCESS
    for ask in (places.txRxPacket, places.fastSyncRead):
        assert ask() == maker.COMM_SUCCESS
        assert [places.getData(n, 116, 4) for n in (2, 3)] == [2002, 2003]
    port.closePort()


def rustypot(device: str) -> None:
    """By rustypot a scan, groups plain and fast, and every mode."""
    from rustypot import Xl330PyController

    servos = Xl330PyController(device, 1_000_000, TIMEOUT)
    assert servos.broadcast_scan([1, 2, 3]) == {1: 1200, 2: 1200, 3: 1200}

    def read(address: int, size: int) -> int:
        return int.from_bytes(bytes(servos.read_raw_data(1, address, size)), "little", signed=True)

    def write(address: int, size: int, value: int) -> None:
        data = (value % (1 << 8 * size)).to_bytes(size, "little")
        assert servos.write_raw_data_with_error(1, address, list(data)) == 0

    in_every_mode(read, write)
    servos.sync_write_position_p_gain([1, 2, 3], [800, 700, 600])
    for fast in (False, True):
        servos.set_fast_sync_read(fast)
        assert list(servos.sync_read_position_p_gain([3, 1])) == [600, 800]


def dxl2(device: str) -> None:
    """dynamixel-python: pings, every mode, and group reads."""
    from dxl2 import v2

    bus = v2.MotorBus(device, 1_000_000)
    bus.connect()

    def read(address: int, size: int) -> int:
        value = int(bus.read(1, address, size).data or 0)
        return value - (1 << 8 * size) if value >> (8 * size - 1) else value

    def write(address: int, size: int, value: int) -> None:
        assert bus.write(1, address, size, value % (1 << 8 * size)).ok

    assert bus.ping(2).data == {"model_number": 1200, "firmware_version": 52}
    in_every_mode(read, write)
    group = v2.SyncParams(116, 4, signed=True)
    for number in (2, 3):
        group.add_value(number, 2000 + number)
    bus.sync_write(group)
    group = v2.SyncParams(116, 4, signed=True)
    for number in (2, 3):
        group.add_motor(number)
    assert bus.sync_read(group).data == [2002, 2003]
    assert bus.fast_sync_read(group, signed=True).data == [2002, 2003]
    bus.disconnect()


def sts(device: str) -> None:
    """Six STS3215 by rustypot: positions, a wheel, and the gains."""
    from rustypot import Sts3215PyController

    servos = Sts3215PyController(device, 1_000_000, TIMEOUT)
    arm = [1, 2, 3, 4, 5, 6]
    assert all(servos.ping(number) for number in arm)
    servos.sync_write_torque_enable([1, 5], [True, True])
    servos.sync_write_goal_position([1, 5], [0.3, -0.2])
    until(lambda: abs(servos.read_present_position(1)[0] - 0.3) < 0.05)
    places = servos.sync_read_present_position([1, 5])
    assert abs(places[1] + 0.2) < 0.05
    servos.write_mode(5, 1)
    servos.write_goal_speed(5, 1.0)
    until(lambda: abs(servos.read_present_speed(5)[0] - 1.0) < 0.2)
    servos.write_goal_speed(5, 0.0)
    until(lambda: abs(servos.read_present_speed(5)[0]) < 0.05)
    servos.write_p_coefficient(1, 20)
    assert list(servos.read_p_coefficient(1)) == [20]
    servos.sync_write_torque_enable(arm, [False] * 6)


if __name__ == "__main__":
    {each.__name__: each for each in (sdk, rustypot, dxl2, sts)}[sys.argv[1]](sys.argv[2])
