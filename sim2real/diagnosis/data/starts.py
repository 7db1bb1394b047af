"""Windows that start elsewhere: by half a count of a position, by the error of a speed.

other = further(data, window, joint, 1e-3)
start_errors(data, window)                      # (M,) rad/s or m/s
"""

import mujoco
import numpy as np

from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.recording import rows_before, start_motion
from sim2real.diagnosis.data.speeds import NEAR
from sim2real.diagnosis.data.windows import Window


def speeds_at(data: Data, model: mujoco.MjModel, values: np.ndarray) -> np.ndarray:
    """Return what values (nv,) say of each compared position's speed, (M,).

    A base's turn, of which parts of a quaternion are compared, has none: 0.
    """
    dofs = [np.flatnonzero(model.jnt_qposadr == joint.qpos) for joint in data.joints]
    return np.array([values[model.jnt_dofadr[own]].sum() for own in dofs])


def further(data: Data, window: Window, joint: int, by: float) -> Window:
    """Return a window that starts with one joint at another position."""
    qpos = window.recording.qpos.copy()
    qpos[data.joints[joint].qpos] += by
    return window._replace(recording=window.recording._replace(qpos=qpos))


def faster(data: Data, window: Window, joint: int, by: float) -> Window:
    """Return a window that starts with one joint at the speed of readings that are off by so much.

    The speed is the slope of a line through neighbours.
    """
    model, own = data.models[window.model], window.recording
    step = float(np.median(np.diff(own.time[: 2 * NEAR + 1])))
    times = step * np.arange(-min(NEAR, window.start), NEAR + 1)
    dof = model.jnt_dofadr[model.jnt_qposadr == data.joints[joint].qpos]
    qvel = own.qvel.copy()
    qvel[dof] += by / float(np.sqrt(((times - times.mean()) ** 2).sum()))
    return window._replace(recording=own._replace(qvel=qvel))


def start_errors(data: Data, window: Window) -> np.ndarray:
    """Return the standard deviations of a window's speeds at its start [rad/s or m/s], (M,)."""
    log, model = data.logs[window.log], data.models[window.model]
    part, before = log.rows(window.start, window.last), rows_before(log, window.start)
    return speeds_at(data, model, start_motion(part, model, before).unsure)
