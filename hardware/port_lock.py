"""One program at a serial port: others are refused with the name of the holder.

    lock = PortLock("/dev/ttyUSB0")
    lock.take()                 # SerialPortError: ... is held by 'python -m ...' (process 4711) ...
    lock.release()

Two masters on one bus corrupt each other's packets, and no servo reports it. The lock is the
system's advisory lock (flock) on the device, which pyserial's `exclusive` takes and respects too,
and which goes with the program that held it. Programs that take no lock are found where /proc shows
their open files (Linux). Where the system has no such locks (Windows), a port opens only once
anyway.
"""

import errno
import os
import re
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from hardware.errors import SerialPortError

ENDING = 1.0  # s that a lock without a visible holder is waited for
PROCESSES = Path("/proc")
SERVERS = ("/dev/ptmx", "/dev/pts/ptmx")  # near ends of pseudo terminals


class PortLock:
    """The right to use one serial port.

    Args:
        name: the device's name; one that is not a device, such as the emulated bus's, is not
            locked.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._file: int | None = None

    def take(self) -> None:
        """Take the lock; does nothing if it is held here already.

        Raises:
            SerialPortError: another program has the device open; the message says which.
            OSError: the device cannot be opened.
        """
        if self._file is not None or find_spec("fcntl") is None or not self._is_device():
            return
        if holders := list(_holders(self._name)):
            raise self._refusal(" and ".join(holders))
        import fcntl

        file = os.open(self._name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        ends = time.monotonic() + ENDING
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError as error:
                holders = list(_holders(self._name))
                busy = error.errno in (errno.EAGAIN, errno.EACCES)
                if busy and not holders and time.monotonic() < ends:
                    time.sleep(
                        0.05
                    )  # the process that held it is ending, and closes its files last
                    continue
                os.close(file)
                if not busy:
                    raise
                held = holders or [
                    "an open driver of this program, or one that cannot be seen from here"
                ]
                raise self._refusal(" and ".join(held)) from None
        self._file = file

    def release(self) -> None:
        """Give the lock back; does nothing if it is not held."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _is_device(self) -> bool:
        return os.path.isabs(self._name)

    def _refusal(self, holder: str) -> SerialPortError:
        return SerialPortError(
            f"{self._name} is held by {holder}; a bus has one master: end it first"
        )


def _holders(name: str) -> Iterator[str]:
    """Yield "'command' (process N)" for each other program that is a client of the device."""
    device = os.path.realpath(name)
    for process in PROCESSES.glob("[0-9]*"):
        files = dict(_open_files(process))
        mine = process.name == str(os.getpid())
        if device in files.values() and not mine and not _serves(process, files, device):
            yield f"{_command(process)!r} (process {process.name})"


def _serves(process: Path, files: dict[str, str], device: str) -> bool:
    """Return whether a process holds the near end of this pseudo terminal: it is not a client."""
    for descriptor, file in files.items():
        if file not in SERVERS:
            continue
        try:
            facts = (process / "fdinfo" / descriptor).read_text(encoding="ascii")
        except OSError:
            continue
        number = re.search(r"^tty-index:\s*(\d+)$", facts, re.MULTILINE)
        if number is not None and device == f"/dev/pts/{number[1]}":
            return True
    return False


def _command(process: Path) -> str:
    try:
        return (
            (process / "cmdline").read_bytes().decode(errors="replace").replace("\0", " ").strip()
        )
    except OSError:
        return "a program that has just ended"


def _open_files(process: Path) -> Iterator[tuple[str, str]]:
    """Yield the descriptors of a process and their files, as far as this user may see them."""
    try:
        for descriptor in (process / "fd").iterdir():
            yield descriptor.name, os.readlink(descriptor)
    except OSError:  # another user's process, or one that has just ended
        return
