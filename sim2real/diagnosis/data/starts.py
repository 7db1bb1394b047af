"""Windows that start elsewhere or faster, and how far off a start's speeds are.

other = further(data, window, joint, 1e-3)
start_errors(data, window)                      # (M,) rad/s or m/s
"""

import mujoco
import numpy as np

from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.recording import start_motion, with_rows_before
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
    """Return a window that starts with one joint faster by so much [rad/s or m/s]."""
    model, own = data.models[window.model], window.recording
    qvel = own.qvel.copy()
    qvel[model.jnt_dofadr[model.jnt_qposadr == data.joints[joint].qpos]] += by
    return window._replace(recording=own._replace(qvel=qvel))


def slope_errors(data: Data, window: Window, noise: np.ndarray) -> np.ndarray:
    """Return what noise (M,) [rad or m] makes of slopes at a start, (M,) [rad/s or m/s].

    A slope is that of a line through neighbours.
    """
    model, time = data.models[window.model], window.recording.time
    step = float(np.median(np.diff(time[: 2 * NEAR + 1])))
    times = step * np.arange(-min(NEAR, window.start), NEAR + 1)
    slopes = noise / float(np.sqrt(((times - times.mean()) ** 2).sum()))
    return speeds_at(data, model, np.ones(model.nv)) * slopes


def start_errors(data: Data, window: Window) -> np.ndarray:
    """Return the standard deviations of a window's speeds at its start [rad/s or m/s], (M,)."""
    log, model = data.logs[window.log], data.models[window.model]
    near, row = with_rows_before(log, window.start, window.last)
    return speeds_at(data, model, start_motion(near, model, row).unsure)
