"""Clients that are not ours drive the device file: they speak to it as to real servos.

rustypot (Rust, from PyPI) comes with the extra `test`. LeRobot's motor bus runs if it is installed
(`pip install lerobot`), the maker's C++ SDK if DYNAMIXEL_SDK_CPP names the folder `c++` of a
checkout of DynamixelSDK and g++ is there; they are too large to come with an extra.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import time
from pathlib import Path

import pytest
import yaml

from tests.hardware.conftest import bench_data, many_benches
from tests.hardware.test_main import emulated

CPP = os.environ.get("DYNAMIXEL_SDK_CPP", "")


def needs(module: str, remedy: str) -> pytest.MarkDecorator:
    """Leave a test out, before anything is started, where its client is not installed."""
    missing = importlib.util.find_spec(module) is None
    return pytest.mark.skipif(missing, reason=f"{module} is not installed: {remedy}")


@pytest.fixture
def device(tmp_path):
    """Yield the device file of three emulated servos."""
    model = tmp_path / "three.xml"
    model.write_text(many_benches(3, ""))
    robot = tmp_path / "three.yaml"
    robot.write_text(yaml.safe_dump(bench_data(3, name="three", model=str(model))))
    with emulated(f"robot={robot}") as (path, _):
        yield path


@needs("rustypot", "pip install -e '.[test]'")
def test_rustypot(device):
    """The Rust driver pings, scans, reads and writes in groups, moves a servo and reboots it."""
    import rustypot

    servos = rustypot.Xl330PyController(device, 1_000_000, 1.0)  # s: patient
    assert servos.ping(1)
    assert not servos.ping(9)
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


@needs("lerobot", "pip install lerobot")
def test_lerobot(device, monkeypatch):
    """LeRobot's bus finds its motors at connecting, reads and writes them by name."""
    from lerobot import motors as lerobot  # type: ignore[import-not-found]
    from lerobot.motors.dynamixel import DynamixelMotorsBus  # type: ignore[import-not-found]

    monkeypatch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", 500)  # ms: patient
    mode = lerobot.MotorNormMode.DEGREES
    motors = {f"hinge{i}": lerobot.Motor(i, "xl330-m288", mode) for i in (1, 2, 3)}
    bus = DynamixelMotorsBus(port=device, motors=motors)
    bus.connect()
    try:
        assert bus.ping("hinge2") == 1200
        bus.write("Position_P_Gain", "hinge1", 800)
        assert bus.read("Position_P_Gain", "hinge1") == 800
        bus.enable_torque("hinge1")
        goals = {"hinge1": 2048 + 300, "hinge2": 2048}
        bus.sync_write("Goal_Position", goals, normalize=False)
        time.sleep(0.8)
        found = bus.sync_read("Present_Position", ["hinge1", "hinge2"], normalize=False)
        assert found["hinge1"] == pytest.approx(2048 + 270, abs=60)
        assert found["hinge2"] == pytest.approx(2048, abs=3)
        assert bus.packet_handler.reboot(bus.port_handler, 1) == (0, 0)  # it has no reboot itself
        time.sleep(0.4)
        assert bus.read("Torque_Enable", "hinge1") == 0
    finally:
        bus.disconnect()


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
