"""Servos whose derivative gain acts on the error of position, so on their goal as well.

    spec.add_numeric(name="derivative_time.elbow", data=[0.004])      # s, of an actuator
    ctrl = add_derivatives(model, ctrl, held)

With error e = goal - q and derivative time T = kd / kp, such a servo exerts kp (e + T de/dt)
(K. J. Astrom and T. Hagglund, PID Controllers, 2nd ed. 1995, section 3.2). A position actuator of
the engine has kp (goal - q) - kd dq/dt; the rest is a goal that is ahead of itself by T. Goals are
held, so that their rate is an impulse: goal + T step / dt in the physics step in which it arrives.
A factor on kp or kd, such as of the effects `position_gain` and `derivative_gain`, leaves T as it
is.
"""

import mujoco
import numpy as np

PREFIX = "derivative_time."  # of the name of a number in a model; then the actuator's


def derivative_times(model: mujoco.MjModel) -> np.ndarray:
    """Return the derivative time of each command of a model, (nu,) [s]; 0: on speed alone."""
    times = np.zeros(model.nu)
    for i in range(model.nnumeric):
        number = model.numeric(i)
        if number.name.startswith(PREFIX):
            actuator = model.actuator(number.name.removeprefix(PREFIX)).id
            times[model.actuator_ctrladr[actuator]] = number.data[0]
    return times


def add_derivatives(model: mujoco.MjModel, ctrl: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Return commands with what the servos' derivative gains make of them.

    Args:
        model: with the derivative times.
        ctrl: the command in force at each physics step, (N, K, nu).
        held: the one before, (N, nu).
    """
    times = derivative_times(model)
    if not times.any():
        return ctrl
    steps = np.diff(ctrl, axis=1, prepend=held[:, None])
    return ctrl + times / model.opt.timestep * steps
