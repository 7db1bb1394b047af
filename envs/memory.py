"""Memory that is asked for, held against memory that is there.

    refuse_larger(200_000 * row_bytes(model), "num_rows=200000 robots", "fewer rows")

Without this a machine fills up until the system ends the program without a word.
"""

import os
import resource
from pathlib import Path

import mujoco

from envs.errors import EnvsError, TaskError

ROW = 140_000  # bytes of one MjData without its buffer: measured, 139,600 to 167,000 on four robots
MEMINFO, STATM = Path("/proc/meminfo"), Path("/proc/self/statm")
CGROUP = Path("/sys/fs/cgroup")
UNITS = ("B", "kB", "MB", "GB", "TB", "PB")


def row_bytes(model: mujoco.MjModel) -> int:
    """Return about what one simulation of a batch takes [bytes]."""
    return mujoco.MjData(model).nbuffer + ROW


def available() -> int:
    """Return the memory that a program can still have [bytes].

    A container's limit counts, and so does that of `ulimit -v`. What a container uses includes
    files that were read, which the system frees when memory is needed.
    """
    free = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    try:
        lines = dict(line.split(":") for line in MEMINFO.read_text(encoding="ascii").splitlines())
        free = 1024 * int(lines["MemAvailable"].split()[0])
    except (OSError, KeyError, ValueError):
        pass  # no Linux: all that the machine has
    try:
        limit, used = (
            (CGROUP / f"memory.{name}").read_text().strip() for name in ("max", "current")
        )
        free = min(free, int(limit) - int(used) + _cached())
    except (OSError, ValueError):
        pass  # no container, or one without a limit
    most, _ = resource.getrlimit(resource.RLIMIT_AS)
    if most != resource.RLIM_INFINITY:
        free = min(free, most - _addressed())
    return max(free, 0)


def _cached() -> int:
    """Return the size of a container's file cache [bytes]."""
    try:
        lines = (CGROUP / "memory.stat").read_text(encoding="ascii").splitlines()
        stat = dict(line.split() for line in lines)
        return int(stat["inactive_file"]) + int(stat["active_file"])
    except (OSError, KeyError, ValueError):
        return 0


def _addressed() -> int:
    """Return the size of this process's address space [bytes]; 0 if it is unknown."""
    try:
        return int(STATM.read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    except (OSError, ValueError):
        return 0


def check_memory(needed: float, what: str, remedy: str) -> None:
    """Raise EnvsError where more memory is needed than there is.

    Args:
        needed: bytes.
        what: what needs them, such as "algorithm.pairs=1000 directions".
        remedy: what to ask for instead.

    Raises:
        EnvsError: with both sizes.
    """
    there = available()
    if needed > there:
        raise EnvsError(
            f"{what} need about {format_bytes(needed)} of memory, but {format_bytes(there)} are "
            f"free; "
            f"ask for {remedy}"
        )


def format_bytes(size: float) -> str:
    """Return a number of bytes in words, `3.2 GB`."""
    size, unit = max(size, 0.0), 0
    while size >= 1000 and unit < len(UNITS) - 1:
        size, unit = size / 1000, unit + 1
    return f"{size:.3g} {UNITS[unit]}"


def share_memory(model: mujoco.MjModel) -> None:
    """Let simulations of a model take turns in one memory: none of its bodies sleeps.

    Sleeping saves time and remembers more than the state (MuJoCo, "Sleeping islands").

    Raises:
        TaskError: a model with the other method that does, incremental potential contact.
    """
    model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    if model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_IPC):
        raise TaskError(
            'the model has <flag ipc="enable"/>, whose contacts have a hidden state; remove it'
        )
