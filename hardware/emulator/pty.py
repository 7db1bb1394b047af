"""An emulated robot behind device files, in real time: any program can open them as serial ports.

    serve(EmulatedRobot(load_robot("quad8")), ready=lambda devices: ..., stopped=event.is_set)

Each bus has a device, and so has the IMU if there is one: the far end of a pseudo terminal. Clients
may come and go, or die; the robot stays. Servos understand the speed that the client set, as on a
wire, and bytes are taken no faster than a wire of that speed carries them. Answers that nobody
reads are lost, as in a full serial port.

The wall clock paces the bytes to about a millisecond; what needs exact times uses the loopback in
this process instead. If this process was kept waiting, the robot first catches up with the clock,
so that every answer is of the present. Bytes that came meanwhile may have come at any time of it:
the wait does not count for the servos' watchdogs, so that none trips because the emulator was late.
"""

import fcntl
import heapq
import logging
import math
import os
import select
import struct
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path

from hardware.emulator.bus import run_in_time_order
from hardware.emulator.imu import make_emulated_imu
from hardware.emulator.mechanics import TICK
from hardware.emulator.wires import buses_of
from hardware.emulator.world import EmulatedRobot
from hardware.errors import RobotError

IMU = "imu"  # the name of its device
IDLE = 0.005  # s between looks at the clock while no client writes
SPIN = 0.0015  # s before an answer is due in which this process does not sleep: it may wake late
FURTHEST = 1.0  # s of motion that are caught up at once; of more the robot stands still
AHEAD = 0.01  # s of wire that are taken at once
TCGETS2 = 0x802C542A  # Linux: the settings of a terminal, its speed as a number
_logger = logging.getLogger(__name__)


def serve(
    world: EmulatedRobot,
    ready: Callable[[dict[str, str]], None],
    stopped: Callable[[], bool],
    link: Path | None = None,
) -> None:
    """Serve a world at device files until `stopped()` says so.

    Args:
        world: the robot.
        ready: is called with the devices' paths by name once they can be opened: "" is the only
            bus, else each bus has its own, and `imu` is the IMU.
        stopped: is asked every few milliseconds, between two steps of the robot.
        link: a symbolic link to make to the device, and to remove at the end; of several devices
            each has the name added, such as `robot-imu`.

    Raises:
        RobotError: a link cannot be made, or something else has its name.
    """
    names = devices_of(world)
    links = {} if link is None else {name: link_of(link, name) for name in names}
    for each in links.values():
        check_link(each)
    with ExitStack() as stack:
        ends = {}
        for name in names:
            ends[name] = master, slave = os.openpty()
            stack.callback(os.close, master)
            stack.callback(os.close, slave)
            for end in (master, slave):
                tty.setraw(end)
            stack.enter_context(_linked(links.get(name), os.ttyname(slave)))
        pacer = RealTimeLoop(world, ends)
        ready({name: os.ttyname(slave) for name, (_, slave) in ends.items()})
        while not stopped():
            pacer.step()


def devices_of(world: EmulatedRobot) -> list[str]:
    """Return the names of a robot's devices; a single bus has no name."""
    robot = world.robot
    names = [bus.name for bus in robot.buses] or [""]
    return names if robot.imu is None else [*names, IMU]


def link_of(link: Path, name: str) -> Path:
    """Return the link to the device of this name."""
    return link.with_name(f"{link.name}-{name}") if name else link


def check_link(link: Path) -> None:
    """Refuse a link whose name is taken by something other than a link to a device.

    Raises:
        RobotError: with what is there, or which folder is not.
    """
    if not link.parent.is_dir():
        raise RobotError(f"link={link}: no folder {link.parent}; create it first")
    stale = link.is_symlink() and os.readlink(link).startswith("/dev/")
    if not stale and (link.is_symlink() or link.exists()):
        raise RobotError(
            f"link={link}: this exists and is not a link to a device; "
            "choose another name, or remove it"
        )


@contextmanager
def _linked(link: Path | None, device: str) -> Iterator[None]:
    """Have a symbolic link to the device, if one is wanted."""
    if link is None:
        yield
        return
    try:
        if link.is_symlink():
            link.unlink()
        link.symlink_to(device)
    except OSError as error:
        raise RobotError(f"link={link}: cannot be created: {error.strerror}") from None
    try:
        yield
    finally:
        if link.is_symlink() and os.readlink(link) == device:
            link.unlink()


class Line:
    """Our end of a pseudo terminal, with the bytes in transit to the client.

    Args:
        master: the near end.
        slave: the far end, whose speed a client sets.
    """

    def __init__(self, master: int, slave: int) -> None:
        os.set_blocking(master, False)
        self.master, self._slave = master, slave
        self._waiting: list[tuple[float, int, bytes]] = []
        self._number = 0
        self._lost = False

    @property
    def due(self) -> float:
        """When the next bytes are handed over [s]."""
        return self._waiting[0][0] if self._waiting else math.inf

    def expect(self, arrivals: Iterable[tuple[float, bytes]]) -> None:
        """Hand these bytes over at their times [s]."""
        for arrival, piece in arrivals:
            self._number += 1
            heapq.heappush(self._waiting, (arrival, self._number, piece))

    def hand_over(self, now: float) -> None:
        """Hand over what is due, as far as the client has room for it."""
        while self.due <= now:
            self._give(heapq.heappop(self._waiting)[2])

    def take(self) -> tuple[bytes, int]:
        """Return the client's bytes, and its speed [bits/s]: 0 if the line hangs up."""
        speed = line_speed(self._slave)
        return os.read(self.master, max(int(AHEAD * speed / 10), 1)), speed

    def _give(self, data: bytes) -> None:
        try:
            sent = os.write(self.master, data)
        except BlockingIOError:
            sent = 0
        if sent < len(data) and not self._lost:
            self._lost = True
            _logger.warning("a client reads no answers; what it has no room for is lost")


class RealTimeLoop:
    """A robot and the bytes on its lines, at the clock's pace.

    Args:
        world: the robot.
        ends: near and far ends of its pseudo terminals, by their devices' names.
        clock: source of the time [s].
    """

    def __init__(
        self,
        world: EmulatedRobot,
        ends: Mapping[str, tuple[int, int]],
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._world, self._clock = world, clock
        lines = {name: Line(*pair) for name, pair in ends.items()}
        self._imu = lines.pop(IMU, None)
        self._buses = dict(zip(lines.values(), buses_of(world), strict=True))
        self._lines = [*self._buses, *([self._imu] if self._imu else [])]
        self._frames = make_emulated_imu(world) if self._imu else None
        self._start = clock() - world.time
        self._looked = world.time
        self._skips = False

    def step(self) -> None:
        """Wait a moment for bytes, catch up, take them, and hand answers over."""
        before, readable = self._looked, self._wait()
        self._looked = self._now()
        if readable:  # at some time since the last look
            self._world.pause_watchdogs(max(self._looked - before - IDLE, 0.0))
        self._catch_up()
        if readable:
            self._take(readable, self._now())
        now = self._now()
        for line in self._lines:
            line.hand_over(now)

    def _now(self) -> float:
        """The clock's time as the robot's [s]."""
        return self._clock() - self._start

    def _catch_up(self) -> None:
        """Let the robot go on to the present; it stands still for what takes too long to compute.

        Its servos' counters go on meanwhile, so that their answers fit the clock.
        """
        room = FURTHEST
        while (late := self._now() - self._world.time) > TICK:
            if late > room:
                self._skip(late - room)
            self._advance(self._now())
            room /= 2

    def _skip(self, seconds: float) -> None:
        self._world.skip(seconds)
        if not self._skips:
            self._skips = True
            _logger.warning("this machine is too busy for this robot: some motion is left out")

    def _advance(self, now: float) -> None:
        if self._frames is not None and self._imu is not None:
            self._imu.expect(self._frames.until(now))
        self._world.advance(now)

    def _wait(self) -> list[Line]:
        """Wait for bytes, the next answer, or a moment; return the lines with bytes to take."""
        now = self._now()
        due = min(self._world.time + IDLE, *(line.due for line in self._lines))
        soon = min(line.due for line in self._buses) < now + SPIN
        pause = 0.0 if soon else max(due - now, 0.0)
        free = {line.master: line for line, bus in self._buses.items() if bus.free <= now + AHEAD}
        if self._imu is not None:
            free[self._imu.master] = self._imu
        return [free[end] for end in select.select(list(free), [], [], pause)[0]]

    def _take(self, readable: Sequence[Line], moment: float) -> None:
        """Put what clients wrote on the wires at this moment [s], on all of them together."""
        begun = {}
        for line in readable:
            data, speed = line.take()
            if line is self._imu and self._frames is not None:
                self._frames.take(data, moment, speed)
            elif speed > 0:
                begun[line] = self._buses[line].begin(data, moment, speed)
        done = run_in_time_order(self._world, list(begun.values()))
        for line, arrivals in zip(begun, done, strict=True):
            line.expect(arrivals)


def line_speed(terminal: int) -> int:
    """Return the bits a second that a terminal is set to, also beyond the system's own list."""
    if sys.platform == "linux":
        settings = fcntl.ioctl(terminal, TCGETS2, bytes(44))
        return struct.unpack_from("I", settings, 40)[0]
    return int(termios.tcgetattr(terminal)[5])
