"""Clocks wait for bytes no longer than they must."""

import os
import threading

from hardware.clock import RealClock


def test_bytes_wake_who_waits_for_them():
    """The wait ends with the first byte, or at its moment if none comes."""
    clock, (source, sink) = RealClock(), os.pipe()
    with open(source, "rb") as port, open(sink, "wb", buffering=0) as other:
        begin = clock.now()
        clock.wait_for_bytes(port, begin + 0.05)
        assert clock.now() >= begin + 0.05
        threading.Timer(0.05, other.write, [b"x"]).start()
        begin = clock.now()
        clock.wait_for_bytes(port, begin + 60)
        assert clock.now() < begin + 30
        clock.wait_for_bytes(port, begin - 1)
