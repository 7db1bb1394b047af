"""Numbers that a model states of its servos."""

import mujoco
import numpy as np
import pytest

from envs.errors import TaskError
from envs.servo_numbers import servo_numbers

TEXT = """<mujoco>
  <custom><numeric name="torque_rate.lift" data="5"/><numeric name="other" data="1 2"/></custom>
  <worldbody><body><joint name="turn"/><geom size="0.1"/>
    <body><joint name="lift" axis="0 1 0"/><geom size="0.1"/></body></body></worldbody>
  <actuator><motor name="turn" joint="turn"/><motor name="lift" joint="lift"/></actuator>
</mujoco>"""


def test_each_actuator_has_its_number_or_the_default() -> None:
    """In the model's order; numbers of other names are left alone."""
    model = mujoco.MjModel.from_xml_string(TEXT)
    np.testing.assert_array_equal(servo_numbers(model, "torque_rate", np.inf), [np.inf, 5.0])
    np.testing.assert_array_equal(servo_numbers(model, "derivative_time", 0.0), [0.0, 0.0])


def test_a_number_of_no_actuator_is_refused() -> None:
    """The message names the element and the actuator that was probably meant."""
    model = mujoco.MjModel.from_xml_string(TEXT.replace("rate.lift", "rate.lifd"))
    with pytest.raises(TaskError, match=r"torque_rate\.lifd.*no actuator 'lifd'.*lift.*rename"):
        servo_numbers(model, "torque_rate", np.inf)


@pytest.mark.parametrize("number", ["0", "-5"])
def test_a_number_that_is_not_positive_is_refused(number: str) -> None:
    """A torque that can never change would be no servo's."""
    model = mujoco.MjModel.from_xml_string(TEXT.replace('data="5"', f'data="{number}"'))
    with pytest.raises(TaskError, match=rf"torque_rate\.lift.*{number} must be above 0; remove"):
        servo_numbers(model, "torque_rate", np.inf)
