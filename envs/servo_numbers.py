"""What a model states of its servos beyond the engine's actuators, in `<numeric>` elements.

<numeric name="derivative_time.elbow" data="0.0064"/>     <!-- s -->
<numeric name="torque_rate.elbow" data="31.4"/>           <!-- N·m/s -->

times = servo_numbers(model, "derivative_time", default=0.0)      # (actuators,)
"""

import mujoco
import numpy as np

from envs.errors import TaskError, did_you_mean


def servo_numbers(model: mujoco.MjModel, name: str, default: float) -> np.ndarray:
    """Return the number of this name of each actuator, (actuators,), or the default.

    Raises:
        TaskError: the model states one of an actuator that it does not have.
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
                f"{did_you_mean(whose, actuators)}"
            )
        values[actuators.index(whose)] = number.data[0]
    return values
