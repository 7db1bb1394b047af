"""Arming moves nothing, limits hold from the first command, and a dry run touches nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hardware.emulator.faults import Fault
from hardware.errors import SafetyError
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
    """A joint that lies a little outside its limits is armed where it is, and led back inside."""
    r = rig()
    r.world.mechanics.data.qpos[:] = [2.1, 0.0, 0.0]
    r.world.mechanics.lock(0, True)
    r.guard.arm()
    assert r.guard.last[0] == pytest.approx(2.1, abs=0.01)
    r.world.mechanics.lock(0, False)
    sent = r.guard.command(np.array([3.0, 0.0, 0.0]))
    assert sent.angles[0] == pytest.approx(2.0, abs=2e-3)
    assert sent.limited[0] == "limit"
    assert r.powered == [True] * 3
