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
from sim2real.diagnosis.ground.base import SLIDE
from sim2real.diagnosis.ground.estimate import Estimate
from sim2real.diagnosis.settings import Ground

HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)


class Unknowns(NamedTuple):
    """D directions in which a start may be off, each by one standard deviation."""

    place: np.ndarray  # (D, nv) of positions
    speed: np.ndarray  # (D, nv) of speeds
    known: np.ndarray  # (D,) a tighter standard deviation, of what the encoders said, over this one


def unknowns(estimate: Estimate, model: mujoco.MjModel, row: int, settings: Ground) -> Unknowns:
    """Return the directions in which the state of a row may be off."""
    base, size = estimate.base, model.nv
    place, speed, known = [], [], []

    def add(where: np.ndarray, of_speed: bool, doubt: float, tight: float | None = None) -> None:
        place.append(np.zeros(size) if of_speed else doubt * where)
        speed.append(doubt * where if of_speed else np.zeros(size))
        known.append(1.0 if tight is None else min(tight / doubt, 1.0))

    axes = np.eye(size)
    up = np.zeros(size)
    up[base.dofs] = estimate.lift
    add(up, False, settings.height_doubt)
    for dof in base.spin:
        add(axes[dof], False, settings.turn_doubt if estimate.felt else settings.lean_doubt)
        add(axes[dof], True, float(estimate.slope[row, dof]))
    for dof in base.dofs:
        add(axes[dof], True, float(estimate.slope[row, dof]))
    for dof in _joints(model, estimate):
        usual = float(np.sqrt(np.mean(estimate.qvel[:, dof] ** 2)))
        change = np.diff(estimate.qvel[:, dof])
        jump = float(np.sqrt(np.mean(change**2)))
        add(
            axes[dof],
            False,
            settings.error_rad + settings.late_doubt * usual,
            settings.error_rad,
        )
        add(axes[dof], True, settings.speed_doubt + jump, float(estimate.slope[row, dof]))
    return Unknowns(np.array(place), np.array(speed), np.array(known))


def _joints(model: mujoco.MjModel, estimate: Estimate) -> list[int]:
    """Return the dofs of hinges and slides that were logged."""
    kinds = [int(kind) for kind in model.jnt_type]
    return [
        int(model.jnt_dofadr[j])
        for j in range(model.njnt)
        if kinds[j] in (HINGE, SLIDE)
        and j not in estimate.base.joints
        and f"qpos.{model.joint(j).name}" in estimate.log.columns
    ]


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
