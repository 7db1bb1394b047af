"""Programs that are late, end or die, and joints that mislead: exact counts and states.

The numbers are those of the list in benchmarks/notebook/servos.md.
"""

import itertools
import os
import signal
import time
from dataclasses import replace

import numpy as np
import pytest

from hardware import serial_ports
from hardware.clock import RealClock
from hardware.emulator.faults import Fault
from hardware.errors import ServoError
from hardware.pace import FixedRate
from tests.hardware.rig import Rig, wave


def test_11_a_reversed_joint_counts_nothing(chain):
    """A joint that counts the other way answers everything; it is at the goal's mirror image."""
    real = chain(3)
    servos = tuple(replace(servo, sign=-servo.sign) for servo in real.servos)
    r = Rig(real, believed=replace(real, servos=servos))
    r.run(100, 0.4)
    assert r.counted() == ({},) * 3
    counts = [servo.memory["goal_position"] for servo in r.world.servos]
    assert counts == [round(2048 - 0.4 / (2 * np.pi / 4096))] * 3
    assert r.powered == [True] * 3


def test_15_a_policy_of_60_ms_at_50_hz(rig):
    """Each step loses two deadlines, none is made up for, and no request of the wire is lost."""
    r = rig()
    r.guard.arm()
    asked, pace, times = r.count("asked"), FixedRate(r.clock, 50.0), []
    for k in range(31):
        times.append(pace.wait())
        r.readings.append(r.guard.read())
        r.clock.sleep_until(times[-1] + 0.06)  # a slow policy
        r.guard.command(wave(k))
    assert pace.missed == 2 * 30
    np.testing.assert_allclose(np.diff(times), 0.06)
    assert (np.array(r.count("asked")) - asked).tolist() == [31 + 10, 31 + 11, 31 + 10]
    assert r.counted() == ({},) * 3
    assert [s.memory["bus_watchdog"] for s in r.world.servos] == [5] * 3  # 100 ms: not tripped


def test_15_a_clock_that_is_set(rig, monkeypatch):
    """Setting the date moves no deadline and spoils no answer."""
    r = rig()
    jumps = itertools.cycle([0.0, 4e9, -3600.0])
    monkeypatch.setattr(time, "time", lambda: next(jumps))
    r.run(50, wave)
    assert r.counted() == ({},) * 3
    clock = RealClock()
    first = clock.now()
    assert 0 <= clock.now() - first < 60


@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, "exception", "end"])
def test_16_what_an_end_asks(rig, end):
    """Two shouts to all, then one write and one look at each servo: off, and nothing is lost."""
    r = rig()
    asked = []
    with pytest.raises((KeyboardInterrupt, SystemExit, ZeroDivisionError)), r.guard:
        r.run(30, wave)
        asked = r.count("asked")
        if end == "exception":
            raise ZeroDivisionError
        if end == "end":
            r.guard.stop()
            raise SystemExit
        os.kill(os.getpid(), end)
    assert (np.array(r.count("asked")) - asked).tolist() == [2, 2, 2]
    assert r.counted() == ({},) * 3
    assert r.powered == [False] * 3
    assert [s.memory["bus_watchdog"] for s in r.world.servos] == [5] * 3
    assert r.world.firmware.errors.tolist() == [0, 0, 0]


def test_16_a_killed_program(rig):
    """Nobody says a word: all watchdogs trip after 0.1 s, and the next program switches off."""
    r = rig()
    r.run(30, lambda k: np.full(3, 0.03 * k))
    last, asked = r.clock.now(), r.count("asked")
    watchdogs = []
    for late in (0.09, 0.12):
        r.world.advance(last + late)
        watchdogs.append([s.memory["bus_watchdog"] for s in r.world.servos])
    assert watchdogs == [[5] * 3, [-1] * 3]
    goal = [s.memory["goal_position"] for s in r.world.servos]
    r.world.advance(last + 3.0)
    assert [s.memory["goal_position"] for s in r.world.servos] == goal
    assert r.powered == [True] * 3  # they hold: a limp robot falls
    assert r.count("asked") == asked
    r.start_again()
    assert r.powered == [False] * 3
    assert r.counted() == ({},) * 3


def test_18_the_seam_changes_no_angle(chain):
    """Two robots, one with the seam in its swing: the same angles to the last bit, no count."""
    tracks = []
    for zero in (2048, 4090):
        robot = chain(3, registers={"operating_mode": 4})
        r = Rig(replace(robot, servos=tuple(replace(s, zero=zero) for s in robot.servos)))
        r.run(150, lambda k: np.full(3, 0.6 * np.sin(k / 12)))
        tracks.append(np.array([x.position for x in r.readings]))
        counts = np.array([x.count for x in r.readings])
        assert r.counted() == ({},) * 3
    assert counts.min() < 4096 < counts.max()
    np.testing.assert_array_equal(*tracks)


def test_21_a_slow_adapter_is_asked_nothing(rig, tmp_path, monkeypatch):
    """An adapter whose latency timer is too long is refused before the port is used."""
    r = rig()
    timer = tmp_path / "loopback:chain3" / "latency_timer"
    timer.parent.mkdir()
    timer.write_text("16\n")
    monkeypatch.setattr(serial_ports, "ADAPTERS", tmp_path)
    asked = r.count("asked")
    with pytest.raises(ServoError, match="latency timer is 16 ms"):
        r.driver.connect()
    assert r.count("asked") == asked
    assert r.powered == [False] * 3


@pytest.mark.parametrize("late", [0.004, 0.006, 0.008, 0.02])
def test_05_a_late_answer_is_no_second_servo(rig, late):
    """An answer to a ping that comes with the next one's is not taken for another servo's."""
    r = rig(Fault("late", count=1, value=late))
    r.run(5)
    assert r.powered == [True] * 3


@pytest.mark.slow
def test_22_ten_seconds_of_twelve_servos(chain):
    """Every request is answered: one group read a step and one servo's health in turn."""
    r = Rig(chain(12))
    before = [r.driver.bus_client.counters[n].asked for n in r.driver.ids]
    r.run(500, lambda k: np.full(12, 0.3 * np.sin(k / 20)))
    assert r.counted() == ({},) * 12
    asked = np.array([r.driver.bus_client.counters[n].asked for n in r.driver.ids]) - before
    healths = np.array([500 // 12 + (1 <= i <= 500 % 12) for i in range(12)])
    np.testing.assert_array_equal(asked - healths, np.full(12, asked[0] - healths[0]))
    arming = 1 + 1 + 2 + 8  # a reading, a health, 2 limits, 4 writes, each read back
    assert asked[0] - healths[0] == 500 + arming
