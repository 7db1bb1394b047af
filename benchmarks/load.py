"""What else the machine does while a row runs, and what a process keeps in memory; from /proc.

    load = ForeignLoad()
    work()
    load.cores()            # CPU cores that other programs kept busy meanwhile, or None

A figure that was taken beside another program says little: it is taken again, or read with this
beside it.
"""

import os
import time
from pathlib import Path

PROC = Path("/proc")
TICKS = os.sysconf("SC_CLK_TCK")  # clock ticks a second, the unit of /proc's times


def process_tree() -> list[int]:
    """Return this process and all its descendants that live."""
    parents: dict[int, list[int]] = {}
    for entry in PROC.glob("[0-9]*/stat"):
        fields = _stat(entry)
        if fields:
            parents.setdefault(int(fields[1]), []).append(int(entry.parent.name))
    tree = [os.getpid()]
    for pid in tree:
        tree += parents.get(pid, [])
    return tree


def own_memory(pids: list[int] | None = None) -> int | None:
    """Return the bytes that processes (default: this one) share with none; None without /proc."""
    total = 0
    for pid in [os.getpid()] if pids is None else pids:
        try:
            lines = (PROC / str(pid) / "smaps_rollup").read_text().splitlines()
        except OSError:
            return None
        total += sum(1024 * int(line.split()[1]) for line in lines if line.startswith("Private_"))
    return total


class ForeignLoad:
    """Counts CPU time of the machine and of this process and its children, from its making on."""

    def __init__(self) -> None:
        self._start = self._read()

    def cores(self) -> float | None:
        """Return how many cores other programs kept busy since the start, or None without /proc."""
        now = self._read()
        if now is None or self._start is None:
            return None
        seconds, busy, own = (b - a for a, b in zip(self._start, now, strict=True))
        return max(0.0, (busy - own) / max(seconds, 1e-9))

    def _read(self) -> tuple[float, float, float] | None:
        try:
            user, nice, system, _, _, irq, softirq, steal = map(
                int, (PROC / "stat").read_text().split()[1:9]
            )
        except OSError:
            return None
        own = sum(
            sum(map(int, fields[11:15]))  # a process's own, and what its dead children had taken
            for pid in process_tree()
            if (fields := _stat(PROC / str(pid) / "stat"))
        )
        busy = user + nice + system + irq + softirq + steal
        return time.perf_counter(), busy / TICKS, own / TICKS


def _stat(path: Path) -> list[str]:
    """Return a process's stat file from the state and parent on; nothing if it is gone."""
    try:
        return path.read_text().rpartition(")")[2].split()
    except OSError:
        return []
