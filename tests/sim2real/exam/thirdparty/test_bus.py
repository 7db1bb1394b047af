"""The bus's timing and counts."""

import numpy as np
import pytest

from sim2real.exam.thirdparty.bus import Bus

STAMPS = np.arange(50) * 0.01


def test_commands_arrive_late_and_in_order() -> None:
    """Latency, jitter and a hidden delay add up."""
    bus = Bus(latency=0.001, age=0.0, jitter=0.0005, counts=4096, command_delay=0.004)
    late = bus.arrivals(STAMPS, np.random.default_rng(0)) - STAMPS
    assert 0.0045 <= late.min() < late.max() <= 0.0055


def test_readings_are_old_and_counted() -> None:
    """A joint at 1 rad/s is read where it was, to half a count."""
    bus = Bus(latency=0.0, age=0.002, jitter=0.0, counts=4096, reading_delay=0.01)
    times = np.arange(-1, 1, 0.0005)
    seen = bus.read(STAMPS, times, times[:, None], np.random.default_rng(0))[:, 0]
    count = 2 * np.pi / 4096
    assert np.abs(seen - (STAMPS - 0.012)).max() <= count / 2 + 1e-9
    assert seen / count == pytest.approx(np.round(seen / count))
