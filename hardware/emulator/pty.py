"""An emulated robot behind a device file, in real time: any program can open it as a serial port.

    serve(World(load_robot("quad8")), ready=lambda path: ..., stopped=event.is_set)

The device is the far end of a pseudo terminal. Clients may come and go, or die; the robot stays.
Servos understand the speed that the client set, as on a wire, and bytes are taken no faster than a
wire of that speed carries them. Answers that nobody reads are lost, as in a full serial port.

The wall clock paces the bytes to about a millisecond; what needs exact times uses the loopback in
this process instead. If this process was kept waiting, the robot catches up with the clock in
slices, between which waiting bytes are read; this time does not count for the servos' watchdogs, so
that none trips because the emulator was late.
"""

from __future__ import annotations

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
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from hardware.emulator.wires import bus_of
from hardware.emulator.world import World
from hardware.errors import RobotError

IDLE = 0.005  # s between looks at the clock while nobody writes
SLICE = 0.01  # s that the robot goes on at most before waiting bytes are read
FURTHEST = 2.0  # s that the robot may fall behind; more is left out, which clients notice
AHEAD = 0.01  # s of wire that are taken at once
TCGETS2 = 0x802C542A  # Linux: the settings of a terminal, its speed as a number
_logger = logging.getLogger(__name__)


def serve(
    world: World,
    ready: Callable[[str], None],
    stopped: Callable[[], bool],
    link: Path | None = None,
) -> None:
    """Serve a world at a device file until `stopped()` says so.

    Args:
        world: the robot.
        ready: is called with the device's path once it can be opened.
        stopped: is asked every few milliseconds, between two steps of the robot.
        link: a symbolic link to make to the device, and to remove at the end.

    Raises:
        RobotError: the link cannot be made, or something else has its name.
    """
    if link is not None:
        check_link(link)
    master, slave = os.openpty()
    try:
        for end in (master, slave):
            tty.setraw(end)
        device = os.ttyname(slave)
        with _linked(link, device):
            wire = Wire(world, master, slave)
            ready(device)
            while not stopped():
                wire.step()
    finally:
        os.close(master)
        os.close(slave)


def check_link(link: Path) -> None:
    """Refuse a link in whose place there is something that is no link to a device.

    Raises:
        RobotError: with what is there, or which folder is not.
    """
    if not link.parent.is_dir():
        raise RobotError(f"link={link}: there is no folder {link.parent}; make it first")
    stale = link.is_symlink() and os.readlink(link).startswith("/dev/")
    if not stale and (link.is_symlink() or link.exists()):
        raise RobotError(
            f"link={link}: there is something of that name, and it is no link to a device; "
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
        raise RobotError(f"link={link}: it cannot be made: {error.strerror}") from None
    try:
        yield
    finally:
        if link.is_symlink() and os.readlink(link) == device:
            link.unlink()


class Wire:
    """The bytes between the near end of a pseudo terminal and a robot, at the clock's pace.

    Args:
        world: the robot.
        master: the near end.
        slave: the far end, whose speed a client sets.
        clock: the time [s].
    """

    def __init__(
        self,
        world: World,
        master: int,
        slave: int,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        os.set_blocking(master, False)
        self._world, self._bus = world, bus_of(world)
        self._master, self._slave, self._clock = master, slave, clock
        self._start = clock() - world.time
        self._waiting: list[tuple[float, int, bytes]] = []
        self._number = 0
        self._lost = False

    def step(self) -> None:
        """Wait a moment for bytes, take them and hand answers over; the robot goes on meanwhile."""
        readable = self._wait()
        now, before = self._now(), self._world.time
        moment = min(now, before + SLICE)
        if moment < now:
            self._world.excuse(moment - before)
        if readable:
            self._take(moment)
        self._world.advance(moment)
        while self._waiting and self._waiting[0][0] <= now:
            self._give(heapq.heappop(self._waiting)[2])

    def _now(self) -> float:
        """The clock's time as the robot's [s]; the robot loses what it cannot catch up with."""
        now = self._clock() - self._start
        late = now - self._world.time - FURTHEST
        if late > 0:
            self._start += late
        return now - max(late, 0.0)

    def _wait(self) -> bool:
        """Wait for bytes, the next answer, or a moment; say whether there are bytes to take."""
        now = self._now()
        due = self._waiting[0][0] if self._waiting else math.inf
        late = now - self._world.time > SLICE
        pause = 0.0 if late else min(max(due - now, 0.0), IDLE)
        free = self._bus.free <= now + AHEAD
        return bool(select.select([self._master] if free else [], [], [], pause)[0])

    def _take(self, moment: float) -> None:
        """Put what the client wrote on the wire at this moment [s]."""
        speed = line_speed(self._slave)
        data = os.read(self._master, max(int(AHEAD * speed / 10), 1))
        if speed == 0:
            return  # the line hangs up
        for arrival, piece in self._bus.feed(data, moment, speed):
            self._number += 1
            heapq.heappush(self._waiting, (arrival, self._number, piece))

    def _give(self, data: bytes) -> None:
        """Hand an answer over, as far as the client has room for it."""
        try:
            sent = os.write(self._master, data)
        except BlockingIOError:
            sent = 0
        if sent < len(data) and not self._lost:
            self._lost = True
            _logger.warning("a client reads no answers; what it has no room for is lost")


def line_speed(terminal: int) -> int:
    """Return the bits a second that a terminal is set to, also beyond the system's own list."""
    if sys.platform == "linux":
        settings = fcntl.ioctl(terminal, TCGETS2, bytes(44))
        return struct.unpack_from("I", settings, 40)[0]
    return int(termios.tcgetattr(terminal)[5])
