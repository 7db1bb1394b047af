"""Arming moves nothing, limits hold from the first command, and a dry run touches nothing."""

from dataclasses import replace

import numpy as np
import pytest

from hardware.config import make_robot
from hardware.emulator.faults import Fault
from hardware.errors import RobotError, SafetyError
from tests.hardware.conftest import bench_data
from tests.hardware.rig import wave


def test_dry_run_writes_nothing(rig):
    """A dry run reads and checks, but no goal and no torque reach the servos."""
    r = rig(dry_run=True)
    before = [bytes(s.memory.data[64:120]) for s in r.world.servos]
    r.run(50, wave)
    assert r.powered == [False] * 3
    assert [bytes(s.memory.data[64:120]) for s in r.world.servos] == before
    assert r.sent.angles == pytest.approx(wave(49))


def test_a_torque_limit_holds(rig, chain):
    """A servo with a limit of torque never gives more, however far it is from its goal."""
    robot = chain(3)
    servos = tuple(replace(servo, torque=0.2) for servo in robot.servos)
    r = rig(Fault("stuck"), robot=replace(robot, servos=servos))
    seen = []

    def goal(_: int) -> np.ndarray:
        seen.append(np.abs(r.world.mechanics.torque).max())
        return np.full(3, 1.5)

    with pytest.raises(SafetyError, match="stuck"):
        r.run(200, goal)
    assert max(seen) == pytest.approx(0.2, rel=0.02)


def test_safe_start_does_not_move(rig):
    """Arming far from zero moves nothing; going there is as slow as asked."""
    r = rig()
    r.world.mechanics.data.qpos[:] = 1.0
    r.world.advance(r.clock.now() + 1.0)
    r.clock.sleep_until(r.world.time)
    start = r.guard.arm().position
    r.clock.sleep_until(r.clock.now() + 0.06)
    r.world.advance(r.clock.now())
    np.testing.assert_allclose(r.world.mechanics.angle, start, atol=0.2)
    begin = r.clock.now()
    r.guard.move_to(np.zeros(3), speed=0.5)
    assert r.clock.now() - begin >= np.abs(start).max() / 0.5 - 0.1


def test_outside_limits_is_not_armed(rig):
    """A joint outside its limits is not switched on."""
    r = rig()
    r.world.mechanics.data.qpos[:] = [0.0, 2.6, 0.0]
    with pytest.raises(SafetyError, match=r"hinge2 is at 2.*outside its limits"):
        r.guard.arm()
    assert r.powered == [False] * 3


def test_a_start_just_outside_is_led_back(rig):
    """A joint a little outside its limits goes no further out, and back as slowly as asked."""
    r = rig()
    r.world.mechanics.data.qpos[:] = [2.15, 0.0, 0.0]
    r.world.mechanics.lock(0, True)
    r.guard.arm()
    begin = r.guard.last[0]
    assert begin == pytest.approx(2.15, abs=0.01)
    r.world.mechanics.lock(0, False)
    sent = r.guard.command(np.array([3.0, 0.0, 0.0]))
    assert (sent.limited[0], sent.angles[0]) == ("limit", pytest.approx(begin, abs=1e-3))
    goals, write = [], r.driver.command
    r.driver.command = lambda angles: goals.append(angles[0]) or write(angles)
    r.guard.move_to(np.array([3.0, 0.0, 0.0]), speed=0.5)
    steps = np.arange(1, len(goals) + 1) * 0.5 / r.driver.robot.rate
    np.testing.assert_allclose(goals, np.maximum(begin - steps, 2.0), atol=1e-9)
    assert r.world.servos[0].memory["goal_position"] == r.driver.counts(np.array([2.0, 0, 0]))[0]
    assert r.powered == [True] * 3


def test_a_current_over_the_limit_of_the_robots_file_stops(rig, chain):
    """A servo that pushes against a stop is named with what it draws and what it may."""
    robot = chain(3)
    servos = tuple(replace(s, current=0.4) for s in robot.servos)
    r = rig(Fault("stuck", servo=2), robot=replace(robot, servos=servos))
    with pytest.raises(
        SafetyError,
        match=r"hinge2 draws \d\.\d\d A, over its limit of 0\.40 A, for more than 0\.5 s",
    ):
        r.run(200, lambda k: np.full(3, min(0.02 * k, 0.45)))
    assert r.powered == [False] * 3


def test_a_short_peak_of_current_stops_nothing(rig, chain):
    """What a quick step draws for a moment is no overload."""
    robot = chain(3)
    servos = tuple(replace(s, current=0.2) for s in robot.servos)
    r = rig(robot=replace(robot, servos=servos))
    r.run(100, lambda k: np.full(3, 0.5 * (k // 10 % 2)))
    assert max(np.abs(x.current).max() for x in r.readings) > 0.2
    assert r.powered == [True] * 3


def test_a_load_over_the_limit_stops(rig, chain):
    """A servo without a sensor of current reports its load."""
    shared = {"model": "xl430-w250", "velocity": 7.0, "load": 0.15, "supply": {"voltage": 11.1}}
    robot = chain(3, servo=shared, registers={"position_p_gain": 800})
    r = rig(Fault("stuck", servo=3), robot=robot)
    with pytest.raises(SafetyError, match=r"hinge3 is at \d+% of its load, over its limit of 15%"):
        r.run(200, lambda k: np.full(3, min(0.02 * k, 0.45)))
    assert r.powered == [False] * 3


def test_the_servos_own_limits_hold(rig):
    """Limits of current and temperature are read from the servos' registers, not assumed."""
    r = rig(Fault("stuck", servo=2), registers={"hinge2": {"current_limit": 300}})
    with pytest.raises(SafetyError, match=r"hinge2 draws .* A, over its limit of 0\.30 A"):
        r.run(200, lambda k: np.full(3, min(0.02 * k, 0.45)))
    r = rig(registers={"hinge1": {"temperature_limit": 28}})
    with pytest.raises(SafetyError, match=r"hinge1 is at 2\d °C; let it cool \(at most 23"):
        r.run(20)
    assert r.powered == [False] * 3


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [("load", 0.5, "reports its current; give current"), ("current", 0.0, "it is above 0")],
)
def test_a_limit_that_cannot_be_meant_is_refused(chain, key, value, words):
    """A servo has the limit of what it reports."""
    data = bench_data(3, model=str(chain(3).model))
    data["servos"]["hinge2"][key] = value
    with pytest.raises(RobotError, match=rf"servos.hinge2: .*{words}"):
        make_robot(data)
