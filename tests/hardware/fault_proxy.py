"""A link between driver and bus that unplugs, delays, corrupts and drops, in both kinds of time.

`Link` says what becomes of the bytes. `FaultyPort` puts it into the emulated bus in virtual time,
`PtyProxy` between two pseudo terminals in real time.
"""

import errno
import heapq
import itertools
import os
import select
import threading
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import numpy as np

from hardware.emulator.loopback import LoopbackPort
from hardware.protocol import BROADCAST

HEADER = b"\xff\xff\xfd\x00"
ID = 4  # place in a packet


@dataclass
class Link:
    """What is wrong with a link.

    Args:
        back: the time until which the cable is out [s].
        late: how late answers come [s].
        corrupt: the probability that a chunk has a wrong byte, either way.
        missing: the ID of a servo that neither hears nor answers.
        dead: whether whoever wrote is gone: nothing passes.
        rng: of corruption.
    """

    back: float = -np.inf
    late: float = 0.0
    corrupt: float = 0.0
    missing: int | None = None
    dead: bool = False
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0))

    def to_bus(self, data: bytes) -> bytes:
        """Return what the servos get of a chunk."""
        return b"" if self.dead or self._to(data, (self.missing,)) else self._harmed(data)

    def to_host(self, data: bytes) -> list[tuple[float, bytes]]:
        """Return (delay [s], bytes) of what the host gets of a chunk."""
        lost = self.missing is not None and self._to(data, (self.missing, BROADCAST))
        return [] if self.dead or lost else [(self.late, self._harmed(data))]

    def _to(self, data: bytes, numbers: tuple[int | None, ...]) -> bool:
        return data[:ID] == HEADER and len(data) > ID and data[ID] in numbers

    def _harmed(self, data: bytes) -> bytes:
        if not data or self.corrupt == 0 or self.rng.random() >= self.corrupt:
            return data
        changed = bytearray(data)
        changed[self.rng.integers(len(data))] ^= 0xFF
        return bytes(changed)


class FaultyPort(LoopbackPort):
    """The emulated bus behind a link, in virtual time; `on_write` is called before each write."""

    def __init__(self, world, clock, link: Link) -> None:
        super().__init__(world, clock)
        self.link = link
        self.on_write: Callable[[], None] = lambda: None

    def writePort(self, packet: list[int] | bytes) -> int:
        """Write what passes the link."""
        self.on_write()
        self._check_cable()
        super().writePort(self.link.to_bus(bytes(packet)))
        return len(packet)

    def expect(self, arrival: float, data: bytes) -> None:
        """Take answers that pass the link."""
        for delay, piece in self.link.to_host(data):
            super().expect(arrival + delay, piece)

    def _check_cable(self) -> None:
        if self.clock.now() < self.link.back:
            raise OSError(errno.EIO, "Input/output error")


class PtyProxy:
    """A pseudo terminal at `path`, a link to an emulator's device, and a thread between them.

    Args:
        device: the emulator's.
        path: where the program finds its port.
        link: what is wrong; its times are those of `time.monotonic`.
    """

    def __init__(self, device: str, path: Path, link: Link) -> None:
        self.link, self._path = link, path
        self._bus = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._ends: tuple[int, int] | None = None
        self._waiting: list[tuple[float, int, bytes]] = []
        self._number, self._over = itertools.count(), threading.Event()
        self._plug()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._over.set()
        self._thread.join()
        self._unplug()
        os.close(self._bus)

    def _plug(self) -> None:
        self._ends = master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self._path.symlink_to(os.ttyname(slave))

    def _unplug(self) -> None:
        if self._ends is not None:
            self._path.unlink()
            for end in self._ends:
                os.close(end)
        self._ends = None
        self._waiting.clear()

    def _run(self) -> None:
        while not self._over.is_set():
            out = time.monotonic() < self.link.back
            if out and self._ends is not None:
                self._unplug()
            elif not out and self._ends is None:
                self._plug()
            near = [] if self._ends is None else [self._ends[0]]
            ready, _, _ = select.select([self._bus, *near], [], [], 0.001)
            for end in ready:
                self._pass_on(end)
            while self._waiting and self._waiting[0][0] <= time.monotonic():
                piece = heapq.heappop(self._waiting)[2]
                if self._ends is not None:
                    os.write(self._ends[0], piece)

    def _pass_on(self, end: int) -> None:
        try:
            data = os.read(end, 4096)
        except OSError:
            return
        if end != self._bus:
            os.write(self._bus, b"".join(map(self.link.to_bus, _packets(data))))
            return
        for packet in _packets(data):
            for delay, piece in self.link.to_host(packet):
                place = (time.monotonic() + delay, next(self._number), piece)
                heapq.heappush(self._waiting, place)


def _packets(data: bytes) -> list[bytes]:
    """Cut a chunk where packets begin."""
    first, *rest = data.split(HEADER)
    return [*([first] if first else []), *(HEADER + part for part in rest)]
