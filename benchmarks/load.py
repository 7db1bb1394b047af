"""What else the machine does while a row runs, and what a process keeps in memory.

    load = ForeignLoad()
    work()
    load.cores()            # CPU cores that other programs kept busy meanwhile

A figure that was taken beside another program says little: it is taken again, or read with this
beside it.
"""

import time

import psutil

BUSY = ("user", "nice", "system", "irq", "softirq", "steal")  # kinds of CPU time that is spent


def process_tree() -> list[psutil.Process]:
    """Return this process and all its descendants that live."""
    own = psutil.Process()
    return [own, *own.children(recursive=True)]


def own_memory(pids: list[int] | None = None) -> int | None:
    """Return the bytes that processes (default: this one) share with none; None if one is gone."""
    try:
        return sum(psutil.Process(pid).memory_full_info().uss for pid in pids or [None])
    except psutil.Error:
        return None


class ForeignLoad:
    """Counts CPU time of the machine and of this process and its children, from its making on."""

    def __init__(self) -> None:
        self._start = self._read()

    def cores(self) -> float:
        """Return how many cores other programs kept busy since the start."""
        seconds, busy, own = (b - a for a, b in zip(self._start, self._read(), strict=True))
        return max(0.0, (busy - own) / max(seconds, 1e-9))

    def _read(self) -> tuple[float, float, float]:
        times = psutil.cpu_times()
        busy = sum(getattr(times, kind, 0.0) for kind in BUSY)
        return time.perf_counter(), busy, sum(map(_spent, process_tree()))


def _spent(process: psutil.Process) -> float:
    """Return a process's CPU time and what its dead children had taken [s]; 0 if it is gone."""
    try:
        return sum(process.cpu_times()[:4])
    except psutil.Error:
        return 0.0
