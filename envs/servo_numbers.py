"""What a model states of its servos beyond the engine's actuators, in `<numeric>` elements.

    times = servo_numbers(model, DERIVATIVE_TIME, default=0.0)      # (actuators,)
    remove_servo_numbers(spec)                                      # where other servos follow

The time that a derivative gain is worth [s], and how fast a servo lets its torque change [N·m/s]:

    <numeric name="derivative_time.elbow" data="0.0064"/>
    <numeric name="torque_rate.elbow" data="31.4"/>
"""

import mujoco
import numpy as np

from envs.errors import TaskError, did_you_mean

DERIVATIVE_TIME, TORQUE_RATE = "derivative_time", "torque_rate"


def servo_numbers(model: mujoco.MjModel, name: str, default: float) -> np.ndarray:
    """Return the number of this name of each actuator, (actuators,), or the default.

    Args:
        model: states numbers of some actuators, or none.
        name: of the number, without the actuator's.
        default: of actuators of which the model states none.

    Raises:
        TaskError: the model states one of an actuator that it does not have, or one that is not
            positive.
    """
    actuators = [model.actuator(i).name for i in range(model.nactuator)]
    values = np.full(len(actuators), default)
    for i in range(model.nnumeric):
        number = model.numeric(i)
        what, _, whose = number.name.partition(".")
        if what != name:
            continue
        if whose not in actuators:
            raise TaskError(
                f'<numeric name="{number.name}">: the model has no actuator {whose!r}'
                f"{did_you_mean(whose, actuators)}; rename the element, or remove it"
            )
        if not number.data[0] > 0:
            raise TaskError(
                f'<numeric name="{number.name}">: {number.data[0]:g} must be above 0; remove the '
                "element if the servo has none"
            )
        values[actuators.index(whose)] = number.data[0]
    return values


def remove_servo_numbers(spec: mujoco.MjSpec) -> None:
    """Remove from a model, in place, what it states of its servos: others take their place."""
    for number in list(spec.numerics):
        if number.name.partition(".")[0] in (DERIVATIVE_TIME, TORQUE_RATE):
            spec.delete(number)
