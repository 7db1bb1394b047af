"""An emulated robot behind a device file, in real time: any program can open it as a serial port.

    serve(World(load_robot("quad8")), ready=lambda path: ..., stopped=event.is_set)

The device is the far end of a pseudo terminal. Clients may come and go, or die; the robot stays.
The wall clock paces the bytes to about a millisecond; what needs exact times uses the loopback in
this process instead. The robot's speed is the one that the client set, where the system tells it.
"""

from __future__ import annotations

import heapq
import os
import select
import termios
import time
import tty
from collections.abc import Callable
from pathlib import Path

from hardware.emulator.bus import Bus
from hardware.emulator.world import World

IDLE = 0.005  # s between looks at the clock while nobody writes
FURTHEST = 2.0  # s that the robot may fall behind before its time is moved, which clients notice
SPEEDS = {
    getattr(termios, f"B{baud}"): baud
    for baud in (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000)
    if hasattr(termios, f"B{baud}")
}


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
        stopped: is asked every few milliseconds.
        link: a symbolic link to make to the device, and to remove at the end.
    """
    master, slave = os.openpty()
    try:
        for end in (master, slave):
            tty.setraw(end)
        device = os.ttyname(slave)
        if link is not None:
            link.unlink(missing_ok=True)
            link.symlink_to(device)
        ready(device)
        _run(world, master, slave, stopped)
    finally:
        if link is not None:
            link.unlink(missing_ok=True)
        os.close(master)
        os.close(slave)


def _run(world: World, master: int, slave: int, stopped: Callable[[], bool]) -> None:
    start, bus = time.perf_counter(), Bus(world)
    waiting: list[tuple[float, int, bytes]] = []
    number = 0
    while not stopped():
        now = time.perf_counter() - start
        pause = min(waiting[0][0] - now, IDLE) if waiting else IDLE
        readable, _, _ = select.select([master], [], [], max(pause, 0.0))
        now = time.perf_counter() - start
        if now - world.time > FURTHEST:
            start += now - world.time
            now = world.time
        if readable:
            data = os.read(master, 4096)
            for arrival, piece in bus.feed(data, now, _baud(world, slave)):
                number += 1
                heapq.heappush(waiting, (arrival, number, piece))
        while waiting and waiting[0][0] <= now:
            os.write(master, heapq.heappop(waiting)[2])
        world.advance(now)


def _baud(world: World, slave: int) -> int:
    return SPEEDS.get(termios.tcgetattr(slave)[5], world.robot.bus.baud)
