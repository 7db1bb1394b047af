"""The device file: speeds, clients that do not read, links, and a robot that keeps up."""

import fcntl
import os
import struct
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hardware import protocol
from hardware.config import load_robot
from hardware.emulator.pty import FURTHEST, TCGETS2, RealTimeLoop, line_speed, serve
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError
from hardware.protocol import Parser, instruction_packet

TCSETS2, CBAUD, BOTHER = 0x402C542B, 0o010017, 0o010000
PING = instruction_packet(1, protocol.PING)


def set_speed(terminal: int, speed: int) -> None:
    """Set any speed, as a serial port's driver does that the system's list does not bind."""
    settings = bytearray(fcntl.ioctl(terminal, TCGETS2, bytes(44)))
    flags = struct.unpack_from("I", settings, 8)[0]
    struct.pack_into("I", settings, 8, flags & ~CBAUD | BOTHER)
    struct.pack_into("2I", settings, 36, speed, speed)
    fcntl.ioctl(terminal, TCSETS2, bytes(settings))


class Client:
    """A client at the far end of a wire whose clock the test moves."""

    def __init__(self, world: EmulatedRobot) -> None:
        self.world, self.now = world, 0.0
        self.master, self.slave = os.openpty()
        for end in (self.master, self.slave):
            tty.setraw(end)
        os.set_blocking(self.slave, False)
        set_speed(self.slave, 1_000_000)
        self.wire = RealTimeLoop(world, {"": (self.master, self.slave)}, lambda: self.now)

    def wait(self, seconds: float, every: float = 0.002) -> bytes:
        """Let the clock go on in steps, and return what can be read."""
        for _ in range(round(seconds / every)):
            self.now += every
            self.wire.step()
        try:
            return os.read(self.slave, 100_000)
        except BlockingIOError:
            return b""

    def close(self) -> None:
        """Give the pseudo terminal back."""
        os.close(self.master)
        os.close(self.slave)


@pytest.fixture
def client() -> Iterator[Client]:
    """Return a client of bench1."""
    made = Client(EmulatedRobot(load_robot("bench1")))
    yield made
    made.close()


UNHEARD = (9600, 19200, 38400, 57600, 115_200, 230_400, 460_800, 500_000, 2_000_000, 4_500_000)


@pytest.mark.parametrize(
    ("speed", "answers"), [(1_000_000, 1), (1_020_000, 1), *((speed, 0) for speed in UNHEARD)]
)
def test_servos_hear_their_own_speed_only(client, speed, answers):
    """Whatever speed a client sets, also beyond the system's list: only the servos' is answered."""
    set_speed(client.slave, speed)
    assert line_speed(client.slave) == speed
    os.write(client.slave, PING)
    assert len(Parser().feed(client.wait(0.05))) == answers


def test_a_servo_of_an_unlisted_speed():
    """A servo of 4.5 Mbit/s answers a client of that speed."""
    world = EmulatedRobot(load_robot("arm6"))
    world.servos[0].memory["baud_rate"] = 7
    client = Client(world)
    set_speed(client.slave, 4_500_000)
    os.write(client.slave, PING)
    (packet,) = Parser().feed(client.wait(0.05))
    assert (packet.id, packet.error) == (1, 0)
    client.close()


def test_a_stall_trips_no_watchdog(client):
    """After a second without the processor time is caught up, and waiting bytes are then read.

    The client goes on asking 50 times a second, its servo's watchdog allows 0.1 s.
    """
    servo, parser = client.world.servos[0], Parser()
    for address, value in ((64, 1), (98, 5)):
        assert servo.write(address, bytes([value]), 0.0) == 0

    def ask(seconds: float) -> int:
        found = 0
        for _ in range(round(seconds / 0.02)):
            os.write(client.slave, PING)
            found += len(parser.feed(client.wait(0.02)))
        return found

    assert ask(0.2) >= 8
    client.now += 1.0
    assert ask(0.1) >= 3
    assert ask(1.2) >= 58
    assert servo.memory["bus_watchdog"] == 5
    assert client.world.time == pytest.approx(client.now, abs=0.02)
    client.wait(0.3)
    assert servo.memory["bus_watchdog"] == -1


def ask_tick(client: Client) -> int:
    """Return a servo's millisecond counter, asked for without letting the clock go on before."""
    os.write(client.slave, instruction_packet(1, protocol.READ, struct.pack("<HH", 120, 2)))
    client.wire.step()
    (packet,) = Parser().feed(client.wait(0.01))
    return int.from_bytes(packet.params[1:3], "little")


@pytest.mark.parametrize("stall", [0.0, 0.2, 3 * FURTHEST])
def test_after_a_stall_the_first_answer_is_of_the_present(client, stall):
    """However long the emulator was kept waiting, a counter is what the clock says it must be."""
    client.wait(0.1)
    client.now += stall
    begin = client.now
    tick = ask_tick(client)
    assert 1000 * begin <= tick <= 1000 * client.now


def test_motion_that_takes_too_long_to_compute_is_left_out(client, caplog):
    """A stall of up to FURTHEST is computed whole; of a longer one the robot loses the rest."""
    client.world.mechanics.data.qpos[:] = 1.0
    client.now += FURTHEST
    client.wire.step()
    assert client.world.firmware.ticks == round(1000 * FURTHEST) + 1
    moved = client.world.mechanics.data.time
    assert moved == pytest.approx(FURTHEST, abs=0.002)
    assert not caplog.messages
    client.now += 10.0
    client.wire.step()
    assert client.world.time == pytest.approx(client.now, abs=0.002)
    assert client.world.mechanics.data.time - moved == pytest.approx(FURTHEST, abs=0.003)
    assert caplog.messages == ["this machine is too busy for this robot: some motion is left out"]


def test_bytes_are_taken_as_fast_as_the_wire_carries_them(client):
    """A client that floods a slow line is held up; the robot does not run ahead of the clock."""
    set_speed(client.slave, 9600)
    written = 0
    for _ in range(100):
        try:
            written += os.write(client.slave, bytes(4096))
        except BlockingIOError:
            client.wait(0.01)
    client.wait(0.1)
    assert written < 100 * 4096
    assert client.world.time < client.now + 0.03


def serving(world: EmulatedRobot, link: Path | None = None) -> tuple[str, Callable[[], bool]]:
    """Serve a world in a thread; return its device, and what ends it and says whether it ended."""
    over, devices, is_open = threading.Event(), [], threading.Event()

    def ready(found: dict[str, str]) -> None:
        devices.extend(found.values())
        is_open.set()

    thread = threading.Thread(target=serve, args=(world, ready, over.is_set, link), daemon=True)
    thread.start()
    assert is_open.wait(30)

    def end() -> bool:
        over.set()
        thread.join(10)
        return not thread.is_alive()

    return devices[0], end


def test_a_client_that_does_not_read_freezes_nothing(caplog):
    """Answers that nobody reads are lost; the robot goes on, serves again, and ends when told."""
    world = EmulatedRobot(load_robot("bench1"))
    device, end = serving(world)
    client = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    set_speed(client, 4_000_000)
    world.servos[0].memory["baud_rate"] = 6
    read = instruction_packet(1, protocol.READ, struct.pack("<HH", 0, 200))
    deadline = time.perf_counter() + 60
    while not caplog.messages and time.perf_counter() < deadline:
        try:
            os.write(client, read)
        except BlockingIOError:
            time.sleep(0.001)
    assert caplog.messages == ["a client reads no answers; what it has no room for is lost"]
    termios.tcflush(client, termios.TCIOFLUSH)
    time.sleep(0.3)
    termios.tcflush(client, termios.TCIOFLUSH)
    os.write(client, instruction_packet(1, protocol.PING))
    deadline, found = time.perf_counter() + 30, b""
    while not any(p.ok for p in Parser().feed(found)) and time.perf_counter() < deadline:
        time.sleep(0.01)
        try:
            found += os.read(client, 4096)
        except BlockingIOError:
            continue
    assert any(packet.ok for packet in Parser().feed(found))
    os.close(client)
    assert end()


def test_a_link_takes_no_files_place(tmp_path):
    """A file, a folder or a link elsewhere is left alone; a stale link to a device is replaced."""
    file, folder, elsewhere = tmp_path / "data.csv", tmp_path / "folder", tmp_path / "elsewhere"
    file.write_text("precious")
    folder.mkdir()
    elsewhere.symlink_to(file)
    world = EmulatedRobot(load_robot("bench1"))
    for link in (file, folder, elsewhere):
        with pytest.raises(RobotError, match="this exists and is not a link to a device"):
            serve(world, lambda _: None, lambda: True, link)
    assert file.read_text() == "precious"
    assert os.readlink(elsewhere) == str(file)
    with pytest.raises(RobotError, match=r"no folder .*/nowhere; create it first"):
        serve(world, lambda _: None, lambda: True, tmp_path / "nowhere" / "robot")
    stale = tmp_path / "robot"
    stale.symlink_to("/dev/pts/99999")
    device, end = serving(world, stale)
    assert os.readlink(stale) == device
    assert end()
    assert not stale.is_symlink()


def test_the_end_leaves_another_robots_link(tmp_path):
    """A link that a second emulator has taken over stays when the first one ends."""
    link = tmp_path / "robot"
    _, end_first = serving(EmulatedRobot(load_robot("bench1")), link)
    second, end_second = serving(EmulatedRobot(load_robot("bench1")), link)
    assert end_first()
    assert os.readlink(link) == second
    assert end_second()
    assert not link.is_symlink()
