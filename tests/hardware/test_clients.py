"""Clients that are not ours drive the device file: they speak to it as to real servos.

The maker's Python SDK is always there, rustypot (Rust, from PyPI) comes with the extra `test`; more
Python clients are in `test_clients_more.py`, LeRobot is in `test_lerobot.py`. The maker's C++ SDK
runs if DYNAMIXEL_SDK_CPP names the folder `c++` of a checkout of DynamixelSDK and g++ is there.
"""

import importlib.util
import os
import shutil
import struct
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import dynamixel_sdk as sdk
import pytest
import yaml

from tests.hardware.conftest import bench_data, many_benches
from tests.hardware.test_main import emulated

CPP = os.environ.get("DYNAMIXEL_SDK_CPP", "")
PATIENT = 500  # ms that the SDK waits beyond the wire's time, for a busy machine


def needs(module: str, remedy: str) -> pytest.MarkDecorator:
    """Leave a test out, before anything is started, where its client is not installed."""
    missing = importlib.util.find_spec(module) is None
    return pytest.mark.skipif(missing, reason=f"{module} is not installed: {remedy}")


def until(condition: Callable[[], bool], seconds: float = 20) -> None:
    """Wait until a condition holds, and fail if it does not for so long [s]."""
    deadline = time.perf_counter() + seconds
    while not condition():
        assert time.perf_counter() < deadline
        time.sleep(0.05)


@pytest.fixture
def device(tmp_path) -> Iterator[str]:
    """Yield the device file of three emulated servos."""
    model = tmp_path / "three.xml"
    model.write_text(many_benches(3, ""))
    robot = tmp_path / "three.yaml"
    robot.write_text(yaml.safe_dump(bench_data(3, name="three", model=str(model))))
    with emulated(f"robot={robot}") as (path, _):
        yield path


class MakersSdk:
    """The maker's Python SDK at a device, as its examples use it; each answer must be good."""

    def __init__(self, device: str, baud: int) -> None:
        self.port, self.packets = sdk.PortHandler(device), sdk.PacketHandler(2.0)
        assert self.port.openPort()
        assert self.port.setBaudRate(baud)

    def read(self, number: int, address: int, size: int) -> int:
        """Read a signed register."""
        data, result, error = self.packets.readTxRx(self.port, number, address, size)
        assert (result, error) == (sdk.COMM_SUCCESS, 0)
        return int.from_bytes(bytes(data), "little", signed=True)

    def write(self, number: int, address: int, size: int, value: int) -> None:
        """Write a register."""
        data = list((value % (1 << 8 * size)).to_bytes(size, "little"))
        result = self.packets.writeTxRx(self.port, number, address, size, data)
        assert result == (sdk.COMM_SUCCESS, 0)

    def close(self) -> None:
        """Close the port."""
        self.port.closePort()


@pytest.fixture
def makers(device, monkeypatch) -> Iterator[MakersSdk]:
    """Yield the maker's SDK at the device of three servos."""
    monkeypatch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", PATIENT)
    client = MakersSdk(device, 1_000_000)
    yield client
    client.close()


def test_the_makers_sdk_reads_and_writes_in_groups(makers):
    """Sync and bulk writes, and every kind of group read, plain and fast, give what was written."""
    port, packets = makers.port, makers.packets
    for number in (1, 2, 3):
        makers.write(number, 64, 1, 1)
    goals = sdk.GroupSyncWrite(port, packets, 116, 4)
    for number in (1, 2, 3):
        assert goals.addParam(number, struct.pack("<i", 2048 + 100 * number))
    assert goals.txPacket() == sdk.COMM_SUCCESS
    bulk = sdk.GroupBulkWrite(port, packets)
    assert bulk.addParam(1, 65, 1, [1])
    assert bulk.addParam(2, 84, 2, [0x41, 0x01])
    assert bulk.txPacket() == sdk.COMM_SUCCESS
    together = sdk.GroupSyncRead(port, packets, 116, 4)
    single = sdk.GroupBulkRead(port, packets)
    for number in (1, 2, 3):
        assert together.addParam(number)
    assert single.addParam(1, 65, 1)
    assert single.addParam(2, 84, 2)
    assert single.addParam(3, 116, 4)
    for read in (together.txRxPacket, together.fastSyncRead):
        assert read() == sdk.COMM_SUCCESS
        assert [together.getData(n, 116, 4) for n in (1, 2, 3)] == [2148, 2248, 2348]
    for read in (single.txRxPacket, single.fastBulkRead):
        assert read() == sdk.COMM_SUCCESS
        found = single.getData(1, 65, 1), single.getData(2, 84, 2), single.getData(3, 116, 4)
        assert found == (1, 0x141, 2348)
    until(lambda: abs(makers.read(1, 132, 4) - 2143) < 15)
    assert packets.regWriteTxRx(port, 3, 65, 1, [1]) == (sdk.COMM_SUCCESS, 0)
    assert makers.read(3, 65, 1) == 0
    assert packets.action(port, sdk.BROADCAST_ID) == sdk.COMM_SUCCESS
    assert makers.read(3, 65, 1) == 1


def test_the_makers_sdk_sets_servos_up(makers):
    """One servo at a time: another ID, another speed, a factory reset; a scan finds each once."""
    port, packets = makers.port, makers.packets
    makers.write(1, 9, 1, 10)
    makers.write(1, 7, 1, 11)
    assert packets.ping(port, 11) == (1200, sdk.COMM_SUCCESS, 0)
    makers.write(11, 8, 1, 1)
    found = {}
    for baud in (57600, 115_200, 1_000_000, 2_000_000):
        assert port.setBaudRate(baud)
        found |= {number: baud for number in packets.broadcastPing(port)[0]}
    assert found == {11: 57600, 2: 1_000_000, 3: 1_000_000}
    assert port.setBaudRate(57600)
    assert makers.read(11, 9, 1) == 10
    assert packets.factoryReset(port, 11, 0x02) == (sdk.COMM_SUCCESS, 0)
    time.sleep(0.5)
    assert makers.read(11, 9, 1) == -6  # 250, the factory's return delay, as a signed byte
    assert packets.factoryReset(port, 11, 0xFF) == (sdk.COMM_SUCCESS, 0)
    time.sleep(0.5)
    assert packets.ping(port, 1) == (1200, sdk.COMM_SUCCESS, 0)
    assert packets.reboot(port, 1) == (sdk.COMM_SUCCESS, 0)
    time.sleep(0.5)
    assert makers.read(1, 64, 1) == 0


def test_the_makers_sdk_in_every_mode(makers):
    """Current, velocity, position, extended, current-based and PWM mode do what their names say."""
    modes = [  # servo, mode; address, bytes, value of the goal; address, bytes, range of the answer
        (1, 0, (102, 2, 60), (126, 2, 30, 90)),
        (2, 1, (104, 4, 60), (128, 4, 30, 90)),
        (3, 3, (116, 4, 2348), (132, 4, 2248, 2400)),
        (3, 4, (116, 4, 6500), (132, 4, 6000, 6600)),
        (2, 5, (116, 4, -3000), (132, 4, -3100, -2500)),
        (1, 16, (100, 2, 300), (124, 2, 295, 300)),
    ]
    for number, mode, goal, (address, size, least, most) in modes:
        makers.write(number, 64, 1, 0)
        makers.write(number, 11, 1, mode)
        makers.write(number, 64, 1, 1)
        makers.write(number, *goal)
        until(lambda: least <= makers.read(number, address, size) <= most)  # noqa: B023


@needs("rustypot", "pip install -e '.[test]'")
def test_rustypot(device):
    """The Rust driver pings, scans, reads and writes in groups, moves a servo and reboots it."""
    import rustypot

    servos = rustypot.Xl330PyController(device, 1_000_000, 1.0)  # s: patient
    assert servos.ping(1)
    assert not servos.ping(9)
    assert servos.broadcast_scan([1, 2, 3, 9]) == {1: 1200, 2: 1200, 3: 1200}
    assert list(servos.sync_read_model_number([1, 2, 3])) == [1200, 1200, 1200]
    servos.sync_write_position_p_gain([1, 2, 3], [800, 700, 600])
    assert list(servos.sync_read_position_p_gain([3, 1])) == [600, 800]
    servos.sync_write_torque_enable([1], [True])
    servos.sync_write_goal_position([1], [0.5])
    time.sleep(0.8)
    for fast in (False, True):
        servos.set_fast_sync_read(fast)
        angles = servos.sync_read_present_position([1, 2])
        assert angles[0] == pytest.approx(0.45, abs=0.1)
        assert angles[1] == pytest.approx(0.0, abs=0.01)
    assert servos.reboot(1)
    time.sleep(0.4)
    assert list(servos.read_torque_enable(1)) == [False]


@needs("rustypot", "pip install -e '.[test]'")
def test_rustypot_sets_servos_up(device):
    """It changes ID, speed and mode; after PWM mode the extended position mode has all its PWM."""
    import rustypot

    servos = rustypot.Xl330PyController(device, 1_000_000, 1.0)
    servos.write_id(1, 7)
    servos.write_return_delay_time(7, 5)
    servos.write_baud_rate(7, rustypot.Xl330PyController.baudrates()[57600])
    assert servos.broadcast_scan([1, 2, 7]) == {2: 1200}
    servos.set_baudrate(57600)
    assert servos.broadcast_scan([1, 2, 7]) == {7: 1200}
    assert list(servos.read_return_delay_time(7)) == [5]
    servos.write_operating_mode(7, 16)
    servos.write_torque_enable(7, True)
    servos.write_goal_pwm(7, 100)
    servos.write_torque_enable(7, False)
    servos.write_operating_mode(7, 4)
    assert list(servos.read_goal_pwm(7)) == [885]
    servos.factory_reset(7, True, True)
    time.sleep(0.5)
    assert list(servos.read_operating_mode(7)) == [3]
    assert servos.write_raw_data_with_error(7, 11, [2]) == 4  # outside of its range


PROGRAM = """
#include <cstdio>
#include <cstdlib>
#include "dynamixel_sdk.h"
using namespace dynamixel;
template <class F> int patiently(F action) {  // a busy machine misses the SDK's 34 ms
  for (int i = 0; i < 20; i++) if (action() == COMM_SUCCESS) return COMM_SUCCESS;
  return action();
}
int main(int, char **argv) {
  PortHandler *port = PortHandler::getPortHandler(argv[1]);
  PacketHandler *packets = PacketHandler::getPacketHandler(2.0);
  if (!port->openPort() || !port->setBaudRate(1000000)) return 1;
  uint16_t model = 0; uint8_t error = 0;
  if (patiently([&] { return packets->ping(port, 2, &model, &error); })) return 2;
  if (model != 1200) return 2;
  if (patiently([&] { return packets->write1ByteTxRx(port, 1, 64, 1, &error); })) return 3;
  if (error) return 3;
  GroupSyncWrite goals(port, packets, 116, 4);
  for (uint8_t id = 1; id <= 3; id++) {
    int32_t goal = 2048 + 100 * id;
    uint8_t bytes[4] = {uint8_t(goal), uint8_t(goal >> 8), 0, 0};
    if (!goals.addParam(id, bytes)) return 4;
  }
  if (goals.txPacket() != COMM_SUCCESS) return 5;
  GroupFastSyncRead fast(port, packets, 116, 4);
  GroupSyncRead plain(port, packets, 116, 4);
  for (uint8_t id = 1; id <= 3; id++) { fast.addParam(id); plain.addParam(id); }
  if (patiently([&] { return plain.txRxPacket(); })) return 6;
  if (patiently([&] { return fast.txRxPacket(); })) return 7;
  for (uint8_t id = 1; id <= 3; id++) {
    if (int(plain.getData(id, 116, 4)) != 2048 + 100 * id) return 8;
    if (int(fast.getData(id, 116, 4)) != 2048 + 100 * id) return 9;
  }
  if (patiently([&] { return packets->reboot(port, 1, &error); })) return 10;
  port->closePort();
  std::puts("all good");
  return 0;
}
"""


@pytest.mark.skipif(
    not CPP or shutil.which("g++") is None,
    reason="DYNAMIXEL_SDK_CPP does not name the folder c++ of DynamixelSDK, or there is no g++",
)
def test_the_makers_cpp_sdk(device, tmp_path):
    """The maker's C++ SDK pings, writes in groups, reads plainly and fast, and reboots."""
    root = Path(CPP)
    source, program = tmp_path / "client.cpp", tmp_path / "client"
    source.write_text(PROGRAM)
    kept = [
        str(path)
        for path in sorted((root / "src" / "dynamixel_sdk").glob("*.cpp"))
        if not path.stem.endswith(("arduino", "mac", "windows"))
    ]
    include = str(root / "include" / "dynamixel_sdk")
    build = ["g++", "-DLINUX", "-w", "-I", include, str(source), *kept, "-o", str(program)]
    subprocess.run(build, check=True)
    done = subprocess.run([str(program), device], capture_output=True, text=True, timeout=30)
    assert done.returncode == 0, f"step {done.returncode}: {done.stdout}{done.stderr}"
