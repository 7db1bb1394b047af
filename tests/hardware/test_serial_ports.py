"""Ports: what there is, why one is refused, and which one a robot is at."""

import errno
import os
import sys

import pytest
from dynamixel_sdk import PortHandler

from hardware import find_port, serial_ports
from hardware.bus_client import BusClient
from hardware.clock import VirtualClock
from hardware.errors import SerialPortError
from hardware.serial_ports import SerialPort, explain_failure, hints

U2D2 = SerialPort("/dev/ttyUSB0", "FT232H", 0x0403, 0x6014)
BOARD = SerialPort("/dev/ttyACM0", "USB Single Serial", 0x1A86, 0x55D3)
BUILT_IN = SerialPort("/dev/ttyS0")


def test_a_missing_port_lists_those_that_exist(monkeypatch):
    """The sentence names each port that is there, and where to look."""
    monkeypatch.setattr(serial_ports, "serial_ports", lambda: [U2D2, BUILT_IN])
    client = BusClient(PortHandler("/dev/ttyUSB7"), VirtualClock(), 0.001)
    with pytest.raises(SerialPortError) as caught:
        client.open(1_000_000)
    assert str(caught.value) == (
        "/dev/ttyUSB7: no such port; is the cable in? Available: '/dev/ttyUSB0', "
        "'/dev/ttyS0' (python -m hardware find-port)"
    )


@pytest.mark.skipif(sys.platform != "linux", reason="groups are those of Linux")
def test_permission_denied_names_the_group(tmp_path, monkeypatch):
    """The group that owns the device, and the command that adds one to it; root's needs a rule."""
    import grp

    device = tmp_path / "ttyUSB0"
    device.touch()
    denied = PermissionError(errno.EACCES, "Permission denied")
    group = next(g for g in grp.getgrall() if g.gr_name != "root")
    monkeypatch.setattr(
        os, "stat", lambda *_, **__: os.stat_result((0, 0, 0, 0, 0, group.gr_gid, 0, 0, 0, 0))
    )
    assert explain_failure(str(device), denied) == (
        f"{device}: permission denied; it belongs to the group {group.gr_name!r}: sudo usermod -aG "
        f"{group.gr_name} $USER, then log out and in again"
    )
    monkeypatch.setattr(os, "stat", lambda *_, **__: os.stat_result((0,) * 10))
    sentence = explain_failure(str(device), denied)
    assert "only root may use it" in sentence and 'GROUP="dialout"' in sentence


def test_hints(tmp_path, monkeypatch):
    """A slow latency timer comes with the command and the udev rule that lower it."""
    monkeypatch.setattr(serial_ports, "ADAPTERS", tmp_path)
    timer = tmp_path / "ttyUSB0" / "latency_timer"
    timer.parent.mkdir()
    timer.write_text("16\n")
    [hint] = [each for each in hints(U2D2) if "16 ms" in each]
    assert "setserial /dev/ttyUSB0 low_latency" in hint
    assert 'ATTR{latency_timer}="1"' in hint
    timer.write_text("1\n")
    assert hints(U2D2) == []
    assert any("brltty" in hint for hint in hints(BOARD))


def test_the_port_that_goes_with_the_cable():
    """With several on USB the cable is pulled; with one it is that; built-in ports do not count."""
    asked: list[str] = []
    told: list[str] = []

    def ask(prompt: str, meanwhile: object = None) -> str:
        asked.append(prompt)
        return ""

    def go(*looks: list[SerialPort]) -> str | None:
        views = iter(looks)
        return find_port.find_port(ask, told.append, lambda: next(views))

    assert go([U2D2, BUILT_IN]) == "/dev/ttyUSB0"
    assert asked == []
    assert go([U2D2, BOARD, BUILT_IN], [U2D2, BUILT_IN]) == "/dev/ttyACM0"
    assert len(asked) == 1
    assert told[-1] == "the robot is at /dev/ttyACM0: give port=/dev/ttyACM0"
    with pytest.raises(SerialPortError, match="0 ports disappeared with the cable"):
        go([U2D2, BOARD], [U2D2, BOARD])
    with pytest.raises(SerialPortError, match="no serial port is there: plug the adapter in"):
        go([])


def test_without_a_terminal_the_list_is_all():
    """Nobody can pull a cable: the ports are listed, and none is chosen."""
    told: list[str] = []

    def nobody(prompt: str, meanwhile: object = None) -> str:
        raise EOFError

    assert find_port.find_port(nobody, told.append, lambda: [U2D2, BOARD]) is None
    assert told[0] == "/dev/ttyUSB0  FT232H (0403:6014)"
