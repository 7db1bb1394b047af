"""A port that another program holds is refused with that program's name."""

import os
import subprocess
import sys

import pytest

from hardware import port_lock
from hardware.errors import SerialPortError
from hardware.port_lock import PortLock

HOLD = (
    "import sys, time; sys.path.insert(0, {root!r}); from hardware.port_lock import PortLock; "
    "PortLock({device!r}).take(); print('held', flush=True); time.sleep(60)"
)
PROXY = "import os, time; os.openpty(); os.open({device!r}, os.O_RDWR); print('held', flush=True); \
time.sleep(60)"
OPEN = "import os, time; os.open({device!r}, os.O_RDWR); print('held', flush=True); time.sleep(60)"


@pytest.fixture
def device():
    """Yield a pseudo terminal's path, its other end open here."""
    master, slave = os.openpty()
    yield os.ttyname(slave)
    os.close(master)
    os.close(slave)


@pytest.fixture
def program(device):
    """Return a function that runs a program until it holds the device."""
    running = []

    def start(source: str) -> subprocess.Popen:
        text = source.format(device=device, root=os.getcwd())
        process = subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE)
        running.append(process)
        assert process.stdout is not None and process.stdout.readline() == b"held\n"
        return process

    yield start
    for process in running:
        process.kill()
        process.wait()


@pytest.mark.parametrize(
    "source", [HOLD, OPEN, PROXY], ids=["locks it", "only opens it", "serves another terminal"]
)
def test_who_holds_the_port_is_named(device, program, source):
    """Command and process of the holder are told; once it has ended, the port is free."""
    process = program(source)
    lock = PortLock(device)
    with pytest.raises(
        SerialPortError, match=rf"{device} is held by .*python.*\(process {process.pid}\)"
    ):
        lock.take()
    process.kill()
    process.wait()
    lock.take()
    lock.release()


def test_a_holder_that_cannot_be_seen_is_still_refused(device, program, monkeypatch, tmp_path):
    """Where the system does not show other programs' files, the lock itself refuses."""
    program(HOLD)
    monkeypatch.setattr(port_lock, "PROCESSES", tmp_path)
    with pytest.raises(SerialPortError, match="or one that cannot be seen from here"):
        PortLock(device).take()


def test_a_lock_goes_to_the_next(device):
    """Taken twice by its owner, refused to another, free after release; no device, no lock."""
    first, second = PortLock(device), PortLock(device)
    first.take()
    first.take()
    with pytest.raises(SerialPortError, match="one master"):
        second.take()
    first.release()
    second.take()
    second.release()
    PortLock("loopback:bench1").take()


def test_pyserials_exclusive_is_the_same_lock(device):
    """A foreign program that opens the port exclusively is kept out by it, too."""
    serial = pytest.importorskip("serial")
    lock = PortLock(device)
    lock.take()
    with pytest.raises(serial.SerialException, match="exclusively lock"):
        serial.Serial(device, exclusive=True)
    lock.release()
    serial.Serial(device, exclusive=True).close()


def test_the_emulator_of_a_device_is_no_client_of_it():
    """A program that serves the device, and keeps its far end open too, does not hold it."""
    served = (
        "import os, time; m, s = os.openpty(); print(os.ttyname(s), flush=True); time.sleep(60)"
    )
    process = subprocess.Popen([sys.executable, "-c", served], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        lock = PortLock(process.stdout.readline().strip())
        lock.take()
        lock.release()
    finally:
        process.kill()
        process.wait()
