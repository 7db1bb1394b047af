"""The serial ports of this machine: which there are, and why one cannot be used.

    for port in serial_ports():
        print(port)                         # /dev/ttyUSB0  U2D2 (0403:6014)
    raise SerialPortError(explain_failure("/dev/ttyUSB7", error))

Linux gives a serial device to a group (`dialout` or `uucp`), and holds the bytes of an FTDI adapter
such as the U2D2 back for 16 ms by default.
"""

import errno
import os
from pathlib import Path
from typing import NamedTuple

from serial.tools import list_ports

from hardware.errors import format_names

ADAPTERS = Path("/sys/bus/usb-serial/devices")
FTDI, CH340 = 0x0403, 0x1A86  # USB vendors
RULES = "/etc/udev/rules.d/99-servos.rules"
LOW_LATENCY = 'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"'


class SerialPort(NamedTuple):
    """A serial port: its device, what the system calls it, and its USB vendor and product."""

    device: str
    description: str = ""
    vendor: int | None = None
    product: int | None = None

    def __str__(self) -> str:
        usb = "" if self.vendor is None else f" ({self.vendor:04x}:{self.product or 0:04x})"
        return f"{self.device}  {self.description}{usb}".rstrip()


def serial_ports() -> list[SerialPort]:
    """Return the ports of this machine, those on USB first."""
    found = [
        SerialPort(p.device, "" if p.description == "n/a" else p.description, p.vid, p.pid)
        for p in list_ports.comports()
    ]
    return sorted(found, key=lambda port: (port.vendor is None, port.device))


def explain_failure(name: str, error: BaseException) -> str:
    """Return why a port could not be used, and what to do about it.

    Args:
        name: the port.
        error: what the operating system said.
    """
    number = getattr(error, "errno", None)
    if number == errno.ENOENT:
        there = format_names(port.device for port in serial_ports())
        return (
            f"{name}: no such port; is the cable in? Available: {there} "
            "(python -m hardware find-port)"
        )
    if number in (errno.EACCES, errno.EPERM):
        return f"{name}: permission denied{_who_may(name)}"
    return f"{name}: the port is gone ({error}); is the cable in?"


def _who_may(name: str) -> str:
    """Return which group may use a device, and how to join it."""
    try:
        import grp

        group = grp.getgrgid(os.stat(name).st_gid).gr_name
    except (ImportError, OSError, KeyError):
        return ""
    if group == "root":
        return (
            f"; only root may use it: add to {RULES} a line "
            'SUBSYSTEM=="tty", GROUP="dialout", MODE="0660", then plug the adapter in again'
        )
    return (
        f"; it belongs to the group {group!r}: sudo usermod -aG {group} $USER, then log out and in "
        "again"
    )


def latency_timer(name: str) -> float | None:
    """Return how long the adapter at a port holds bytes back [s]; None where the system says not.

    Args:
        name: the port, or a link to it such as those of /dev/serial/by-id.
    """
    timer = ADAPTERS / Path(name).resolve().name / "latency_timer"
    return float(timer.read_text()) / 1000 if timer.is_file() else None


def hints(port: SerialPort) -> list[str]:
    """Return advice on a port that is not set up well."""
    found = []
    if not os.access(port.device, os.R_OK | os.W_OK) and os.path.exists(port.device):
        found.append(explain_failure(port.device, PermissionError(errno.EACCES, "")))
    latency = latency_timer(port.device)
    if latency is not None and latency > 0.001:
        found.append(
            f"{port.device} holds bytes back for {latency * 1e3:.0f} ms: setserial {port.device} "
            f"low_latency; for good, add to {RULES} the line {LOW_LATENCY}"
        )
    if port.vendor == CH340:
        found.append(f"if {port.device} vanishes again at once: sudo apt remove brltty")
    return found
