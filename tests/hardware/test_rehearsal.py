"""What control steps take is measured before torque, and a rate that cannot be kept is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hardware import rehearsal
from hardware.clock import VirtualClock
from hardware.config import load_robot
from hardware.emulator.faults import Fault, Faults
from hardware.errors import ServoError
from hardware.rehearsal import StepTimes, check, problem, rehearse

ROBOT = replace(load_robot("hopper2"), port="/dev/ttyUSB0")  # 100 steps a second, watchdog 0.1 s


def stepping(clock, spans):
    """Return a step that takes these times [s], one after the other."""
    left = iter(spans)
    return lambda: clock.sleep_until(clock.now() + next(left))


def test_what_steps_took():
    """Median, slowest twentieth and longest pause of known times."""
    clock = VirtualClock()
    spans = np.full(100, 0.004)
    spans[50] = 0.043
    times = rehearse(stepping(clock, spans), clock, 100.0)
    assert times.typical == pytest.approx(0.004)
    assert times.slow == pytest.approx(0.004)
    assert times.pause == pytest.approx(0.049)  # 10 ms less the step before, and the long one
    assert times.reply == pytest.approx(0.043)


def test_a_rate_that_cannot_be_kept_is_refused_with_what_was_measured():
    """A port whose slow steps take 12 ms cannot serve 100 steps a second, but 80."""
    said = str(problem(StepTimes(0.004, 0.012, 0.02, 0.012), ROBOT))
    assert "hopper2 at /dev/ttyUSB0: one control step in 20 takes 12.0 ms or more" in said
    assert "100 steps a second leave 10.0 ms" in said
    assert said.endswith("a rate of at most 83")
    assert problem(StepTimes(0.004, 0.012, 0.02, 0.012), replace(ROBOT, rate=80.0)) is None


def test_a_pause_that_would_trip_the_watchdogs_is_refused():
    """Where 72 ms went by between two steps, 100 ms are too few, unless the watchdog is off."""
    times = StepTimes(0.004, 0.006, 0.072, 0.07)
    said = str(problem(times, ROBOT))
    assert "72 ms went by, and the servos stop by themselves after 100 ms" in said
    assert "raise watchdog to 0.18" in said
    assert problem(times, replace(ROBOT, watchdog=0.2)) is None
    assert problem(times, replace(ROBOT, watchdog=0.0)) is None


def test_one_bad_second_is_forgiven(monkeypatch):
    """A machine that was busy at the start is measured again; one that stays so is refused."""
    clock = VirtualClock()
    busy, quiet = np.full(50, 0.02), np.full(100, 0.004)
    times = check(stepping(clock, [*busy, *busy, *quiet]), clock, ROBOT)
    assert times.slow == pytest.approx(0.004)
    monkeypatch.setattr(rehearsal, "ATTEMPTS", 2)
    with pytest.raises(ServoError, match=r"one control step in 20 takes .*; torque stays off"):
        check(stepping(clock, np.full(300, 0.02)), clock, ROBOT)


def test_the_guard_measures_a_real_port_before_it_arms(rig, chain):
    """Arming asks the servos for a second at the robot's rate, once, and writes nothing by it."""
    r = rig()
    r.driver.robot = replace(r.driver.robot, port="/dev/ttyUSB0")
    before, memory = r.clock.now(), [bytes(s.memory.data[:120]) for s in r.world.servos]
    r.driver.measure_step_time()
    assert r.clock.now() - before == pytest.approx(1.0, abs=0.05)
    assert [bytes(s.memory.data[:120]) for s in r.world.servos] == memory
    r.driver.measure_step_time()
    assert r.clock.now() - before == pytest.approx(1.0, abs=0.05)
    r.driver.connect()
    r.world.faults = Faults([Fault("drop")], np.random.default_rng(0))
    with pytest.raises(ServoError, match=r"chain3 at /dev/ttyUSB0: one control step in 20 takes"):
        r.guard.arm()
    assert r.powered == [False] * 3
