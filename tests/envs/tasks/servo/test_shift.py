"""The robots of conf/shift: the simulator and the emulated robot take the same files alike."""

from pathlib import Path

import numpy as np
import pytest

from envs.effects.file import load_effects
from envs.plant import Plant
from envs.tasks import Hopper2, Quad8, Quad12
from envs.tasks.servo.robot import ROBOTS
from hardware.config import load_robot
from hardware.emulator.hidden import read_hidden
from hardware.emulator.world import EmulatedRobot

TASKS = {"quad8": Quad8, "quad12": Quad12, "hopper2": Hopper2}
FILES = [  # of robots with servos
    path
    for path in sorted((ROBOTS.parent / "shift").glob("*.yaml"))
    if (ROBOTS / f"{path.stem.split('_')[0]}.yaml").is_file()
]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_simulator_and_emulated_robot_differ_alike(path: Path) -> None:
    """Masses, friction, supply, delay, gain: the same numbers in both, and not the model's own."""
    task = TASKS[path.stem.split("_")[0]]("servo")
    fixed = load_effects(path)
    plant = Plant(task.spec(), fixed=fixed)
    robot = load_robot(task.machine.name)
    world = EmulatedRobot(robot, hidden=read_hidden(path, robot))
    theirs, own = world.mechanics.model, plant.nominal
    mass = plant.field("body_mass")[0]
    np.testing.assert_allclose(theirs.body_mass, mass)
    friction = np.array([theirs.geom(own.geom(i).name).friction[0] for i in range(own.ngeom)])
    np.testing.assert_allclose(friction, plant.field("geom_friction")[0, :, 0])
    limit = plant.field("actuator_forcerange")[0, :, 1]
    factor = world.firmware.battery / robot.supply.voltage
    np.testing.assert_allclose(limit / own.actuator_forcerange[:, 1], factor)
    delay = plant.field("actuator_delay")[0] - own.actuator_delay
    np.testing.assert_allclose(delay, world.hidden.robot["command_delay"])
    gain = plant.field("actuator_gainprm")[0, :, 0] / own.actuator_gainprm[:, 0]
    held = world.hidden["position_gain"] * factor  # a servo commands a share of its supply
    np.testing.assert_allclose(gain, held)
    changed = [100 * delay, mass - own.body_mass, friction - own.geom_friction[:, 0], factor - 1.0]
    changed.append(gain - 1.0)
    assert any(np.any(np.abs(change) > 1e-3) for change in changed)


def test_there_are_a_load_and_a_slippery_ground_for_both() -> None:
    """Each walking robot has its two."""
    assert {path.stem for path in FILES} >= {
        "quad8_side_mass",
        "quad8_low_friction",
        "quad12_side_mass",
        "quad12_low_friction",
        "hopper2_mass",
        "hopper2_low_friction",
    }
