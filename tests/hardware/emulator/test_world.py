"""An emulated robot can be held until it is armed, as on a stand."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from hardware.config import load_robot
from hardware.emulator.world import EmulatedRobot


def put_torque(world: EmulatedRobot, on: bool) -> None:
    """Switch the torque of all servos."""
    for servo in world.servos:
        assert servo.write(64, bytes([on]), world.time) == 0


def test_a_held_robot_waits_for_its_torque():
    """quad8 collapses without torque; held it stands still until armed, and then by itself."""
    world = EmulatedRobot(load_robot("quad8"))
    world.advance(2.0)
    assert world.mechanics.data.qpos[2] < 0.1

    world.hold()
    home = world.mechanics.data.qpos.copy()
    assert home[2] == pytest.approx(0.1441)
    world.advance(4.0)
    np.testing.assert_array_equal(world.mechanics.data.qpos, home)
    for servo in world.servos:
        goal = servo.memory.kind.registers["goal_position"]
        count = int(world.firmware.count[servo.index])
        assert servo.write(goal.address, goal.encode(count), world.time) == 0
    put_torque(world, True)
    world.advance(6.0)
    assert world.mechanics.data.qpos[2] == pytest.approx(home[2], abs=0.03)
    assert not np.array_equal(world.mechanics.data.qpos, home)
    put_torque(world, False)
    world.advance(8.0)
    assert world.mechanics.data.qpos[2] < 0.1


def test_each_joint_is_let_go_with_its_own_torque(chain):
    """Of three held pendulums the one that is powered moves; it falls when the torque goes."""
    world = EmulatedRobot(chain(3))
    world.hold()
    world.servos[1].write(64, b"\x01", 0.0)
    world.servos[1].write(116, (2500).to_bytes(4, "little"), 0.0)
    world.advance(1.0)
    assert np.flatnonzero(np.abs(world.mechanics.angle) > 1e-9).tolist() == [1]
    world.servos[1].write(64, b"\x00", world.time)
    before = float(world.mechanics.angle[1])
    world.advance(1.3)
    assert abs(world.mechanics.angle[1] - before) > 0.2


def test_an_emulator_writes_no_log_of_the_engine(tmp_path: Path, monkeypatch) -> None:
    """A robot that flies apart leaves no MUJOCO_LOG.TXT where somebody happened to start it."""
    monkeypatch.chdir(tmp_path)
    mechanics = EmulatedRobot(load_robot("bench1")).mechanics
    mechanics.data.qvel[:] = 1e12
    mujoco.mj_step(mechanics.model, mechanics.data, 10)
    assert mechanics.data.warning.number.any()
    assert list(tmp_path.iterdir()) == []
