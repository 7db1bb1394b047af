"""Servos whose derivative gain acts on the error of position, so on their goal as well.

    spec.add_numeric(name="derivative_time.elbow", data=[0.004])      # s, of an actuator
    ctrl = add_derivatives(model, ctrl, held)

With error e = goal - q and derivative time T = kd / kp, such a servo exerts kp (e + T de/dt), the
derivative behind a filter of first order (K. J. Astrom and T. Hagglund, PID Controllers, 2nd ed.
1995, section 3.2). A position actuator of the engine has kp (goal - q) - kd dq/dt; the rest is a
goal that is ahead of itself by T times its filtered rate. A factor on kp or kd, such as of the
effects `position_gain` and `derivative_gain`, leaves T as it is.
"""

import mujoco
import numpy as np
from scipy.signal import lfilter

from envs.servo_numbers import DERIVATIVE_TIME, servo_numbers

FILTER = 0.002  # s; an assumption, since makers do not publish it, as in the emulated servos


def add_derivatives(model: mujoco.MjModel, ctrl: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Return commands with what the servos' derivative gains make of them.

    Args:
        model: with the derivative times.
        ctrl: the command in force at each physics step, (N, K, nu).
        held: the one before, (N, nu).
    """
    times = servo_numbers(model, DERIVATIVE_TIME, 0.0)
    if not times.any():
        return ctrl
    timestep, has = model.opt.timestep, np.flatnonzero(times)
    columns, share = model.actuator_ctrladr[has], timestep / (FILTER + timestep)
    steps = np.diff(ctrl[:, :, columns], axis=1, prepend=held[:, None, columns])
    rates = lfilter([share / timestep], [1.0, share - 1.0], steps, axis=1)
    ahead = ctrl.copy()
    ahead[:, :, columns] += times[has] * rates
    return ahead
