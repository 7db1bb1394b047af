"""Where a window starts: moved by what is not known of it, and refined by what follows.

    unknown = unknowns(estimate, model, row, settings)      # D directions of the state
    moved(model, recording, unknown, amounts)               # (D,), in standard deviations
    clear_starts(error, ways, noise)                        # errors that no start can cause

The unknowns are the base's height, turn and speeds, and the joints' positions and speeds.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from envs.replay import Recording
from sim2real.diagnosis.data.pairs import is_scalar
from sim2real.diagnosis.ground.estimate import Estimate
from sim2real.diagnosis.settings import Ground


class Unknowns(NamedTuple):
    """D directions in which a start may be off, each by one standard deviation."""

    place: np.ndarray  # (D, nv) of positions
    speed: np.ndarray  # (D, nv) of speeds
    known: np.ndarray  # (D,) a tighter standard deviation, of what the encoders said, over this one


def unknowns(estimate: Estimate, model: mujoco.MjModel, row: int, settings: Ground) -> Unknowns:
    """Return the directions in which the state of a row may be off."""
    base, axes, slope = estimate.base, np.eye(model.nv), estimate.slope[row]
    up = axes[base.dofs].T @ estimate.lift
    turn = settings.turn_doubt if estimate.felt else settings.lean_doubt
    ways = [(0, up, settings.height_doubt, settings.height_doubt)]  # position or speed, and doubts
    for dof in base.spin:
        ways += [(0, axes[dof], turn, turn), (1, axes[dof], slope[dof], slope[dof])]
    ways += [(1, axes[dof], slope[dof], slope[dof]) for dof in base.dofs]
    for j in range(model.njnt):
        logged = f"qpos.{model.joint(j).name}" in estimate.log.columns
        if j in base.joints or not is_scalar(model, j) or not logged:
            continue
        dof = int(model.jnt_dofadr[j])
        speed = estimate.qvel[:, dof]
        usual, jump = (float(np.sqrt(np.mean(x**2))) for x in (speed, np.diff(speed)))
        late = settings.error_rad + settings.late_doubt * usual
        ways.append((0, axes[dof], late, settings.error_rad))
        ways.append((1, axes[dof], settings.speed_doubt + jump, slope[dof]))
    part, direction, doubt, known = (np.array(column) for column in zip(*ways, strict=True))
    place, speed = (doubt[:, None] * direction * (part == k)[:, None] for k in (0, 1))
    return Unknowns(place, speed, np.minimum(known / doubt, 1.0))


def moved(
    model: mujoco.MjModel, recording: Recording, unknown: Unknowns, amounts: np.ndarray
) -> Recording:
    """Return a recording whose start is off by amounts (D,) of the unknowns."""
    qpos = recording.qpos.copy()
    mujoco.mj_integratePos(model, qpos, amounts @ unknown.place, 1.0)
    return recording._replace(qpos=qpos, qvel=recording.qvel + amounts @ unknown.speed)


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
