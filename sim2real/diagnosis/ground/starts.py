"""Where a window starts: moved by what is not known of it, and refined by what follows.

    unknown = unknowns(estimate, model, row, settings)      # (2, D, nv) directions of the state
    moved(model, recording, unknown, amounts)               # (D,), in standard deviations
    clear_starts(error, ways, noise)                        # errors that no start can cause

The unknowns are the base's height, turn and speeds, and the joints' positions and speeds.
"""

import mujoco
import numpy as np

from envs.replay import Recording
from sim2real.diagnosis.data.pairs import is_scalar
from sim2real.diagnosis.ground.estimate import Estimate
from sim2real.diagnosis.settings import Ground


def unknowns(estimate: Estimate, model: mujoco.MjModel, row: int, settings: Ground) -> np.ndarray:
    """Return what may be off in the state of a row, each by one standard deviation, (2, D, nv).

    The first are changes of positions, the second of speeds.
    """
    base, axes, log = estimate.base, np.eye(model.nv), estimate.log
    turn = settings.error_rad if estimate.felt else settings.told_rad
    places = [settings.sole_m * estimate.lift @ axes[base.dofs], *(turn * axes[base.spin])]
    dofs = [*base.dofs, *base.spin]
    for j in range(model.njnt):
        logged = f"qpos.{model.joint(j).name}" in log.columns
        if j not in base.joints and is_scalar(model, j) and logged:
            dofs.append(int(model.jnt_dofadr[j]))
            places.append(settings.error_rad * axes[dofs[-1]])
    found = np.zeros((2, len(places) + len(dofs), model.nv))
    found[0, : len(places)] = places
    found[1, len(places) :] = estimate.slope[row, dofs, None] * axes[dofs]
    return found


def moved(
    model: mujoco.MjModel, recording: Recording, unknown: np.ndarray, amounts: np.ndarray
) -> Recording:
    """Return a recording whose start is off by amounts (D,) of the unknowns (2, D, nv)."""
    place, speed = amounts @ unknown
    qpos = recording.qpos.copy()
    mujoco.mj_integratePos(model, qpos, place, 1.0)
    return recording._replace(qpos=qpos, qvel=recording.qvel + speed)


def clear_starts(error: np.ndarray, ways: np.ndarray, noise: float) -> np.ndarray:
    """Return errors without what starts may cause, (W, T, M).

    Their covariance is R + S S', R that of the noise and S the change by one standard deviation of
    each unknown. They are multiplied by the symmetric root of R (R + S S')^-1.

    Args:
        error: of the windows, (W, T, M).
        ways: S, (W, T, M, D).
        noise: standard deviation of each error.
    """
    count = len(error)
    left, size, _ = np.linalg.svd(ways.reshape(count, -1, ways.shape[3]), full_matrices=False)
    gone = 1 - 1 / np.hypot(1.0, size / noise)  # (W, D)
    along = np.einsum("wnd,wn->wd", left, error.reshape(count, -1))
    return error - np.einsum("wnd,wd->wn", left, gone * along).reshape(error.shape)
