"""A robot on its stand: only servos move, nothing touches, and the bus's delay is in the model."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from hardware.config import load_robot
from hardware.stand import home_pose, write_stand_model


@pytest.mark.parametrize("name", ["hopper2", "quad8", "quad12"])
def test_what_no_servo_drives_is_fixed(name: str, tmp_path: Path) -> None:
    """Each joint that is left has a servo, and the pose of the stand is that of the ground."""
    robot = load_robot(name)
    hanging = write_stand_model(robot, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(hanging.model))
    driven = {int(joint) for joint in model.actuator_trnid[:, 0]}
    assert driven == set(range(model.njnt)) and model.njnt == len(robot.servos)
    np.testing.assert_allclose(home_pose(hanging), home_pose(robot))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_step(model, data, 500)
    assert data.ncon == 0


def test_the_declared_delay_of_the_bus_is_in_the_actuators(tmp_path: Path) -> None:
    """An arm, which stands anyway, keeps all its joints and gets the delay."""
    robot = load_robot("arm6")
    model = mujoco.MjModel.from_xml_path(str(write_stand_model(robot, tmp_path).model))
    own = mujoco.MjModel.from_xml_path(str(robot.model))
    assert model.njnt == own.njnt
    np.testing.assert_allclose(model.actuator_delay, robot.command_delay)
