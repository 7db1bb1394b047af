"""Where a model's joints stand when a log begins: logged, coupled, or as the model says.

qpos, ctrl = home(model)
for name, place in positions(log, model).items(): qpos[place] = log.column(f"qpos.{name}")[0]
qpos, qvel = follow_couplings(model, qpos, qvel, positions(log, model).values())
"""

from collections.abc import Collection

import mujoco
import numpy as np

from envs.models import columns_of
from hardware.log import Log

EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
DENSE = int(mujoco.mjtJacobian.mjJAC_DENSE)
ROUNDS = 10  # steps at most to close couplings
CLOSED = 1e-9  # m or rad: their residuals that are rounding
LOOSE = 1e-6  # of a joint's motion by itself: below it is rounding


def home(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """Return pose (nq,) and commands (nu,) of the keyframe `home`, else the model's default."""
    home = next((k for k in range(model.nkey) if model.key(k).name == "home"), None)
    if home is None:
        return model.qpos0.copy(), np.zeros(model.nu)
    return model.key_qpos[home].copy(), model.key_ctrl[home].copy()


def positions(log: Log, model: mujoco.MjModel) -> dict[str, int]:
    """Return where in qpos each logged position belongs: column name without `qpos.` to address."""
    places = {}
    for i in range(model.njnt):
        start, (names, _) = int(model.jnt_qposadr[i]), columns_of(model, i)
        places |= {n: start + k for k, n in enumerate(names) if f"qpos.{n}" in log.columns}
    return places


def follow_couplings(
    model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray, logged: Collection[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return a start whose unlogged joints are where the model's couplings put them.

    Couplings are equality constraints: of two joints, of tendons, of two bodies. Unlogged joints
    are moved until the residuals r of all of them vanish, by Gauss-Newton steps with the engine's
    Jacobian J = [J_known J_free]; speeds fulfil J qvel = 0. A replay that started in the middle of
    a motion with a gear as it stood at home would begin with its snap.

    Args:
        model: the model.
        qpos: position, (nq,); the unlogged part is where the search begins.
        qvel: velocity, (nv,).
        logged: places in qpos of the joints that are known; they stay.
    """
    free = [j for j in range(model.njnt) if int(model.jnt_qposadr[j]) not in logged]
    if not model.neq or not free:
        return qpos, qvel
    dofs = np.flatnonzero(np.isin(model.dof_jntid, free))
    data = mujoco.MjData(model)
    data.qpos[:], moved, left = qpos, np.zeros(model.nv), []
    for _ in range(ROUNDS):
        slopes, residuals = _couplings(model, data)
        left.append(float(np.abs(residuals).max(initial=0.0)))
        if left[-1] < CLOSED:
            break
        moved[dofs] = -np.linalg.pinv(slopes[:, dofs]) @ residuals
        mujoco.mj_integratePos(model, data.qpos, moved, 1.0)
    if left[-1] > left[0]:  # nothing fulfils them from here
        return qpos, qvel
    qvel, known = qvel.copy(), np.setdiff1d(np.arange(model.nv), dofs)
    qvel[dofs] = -np.linalg.pinv(slopes[:, dofs]) @ (slopes[:, known] @ qvel[known])
    return data.qpos.copy(), qvel


def find_led(model: mujoco.MjModel, qpos: np.ndarray, logged: Collection[int]) -> set[int]:
    """Return the unlogged joints whose positions the couplings tell, in a pose (nq,).

    These are the ones that no motion which the couplings allow moves by itself.
    """
    free = np.array([int(model.jnt_qposadr[j]) not in logged for j in model.dof_jntid], bool)
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    slopes, _ = _couplings(model, data)
    alone = np.zeros((model.nv, int(free.sum())))
    alone[free] = np.eye(len(alone.T)) - np.linalg.pinv(slopes[:, free]) @ slopes[:, free]
    loose = np.abs(alone).max(axis=1, initial=0.0) > LOOSE
    return {j for j in range(model.njnt) if not loose[model.dof_jntid == j].any()}


def _couplings(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Return the Jacobian (E, nv) and the residuals (E,) of the couplings at a position."""
    kind, model.opt.jacobian = model.opt.jacobian, DENSE
    try:
        mujoco.mj_fwdPosition(model, data)
    finally:
        model.opt.jacobian = kind
    own = data.efc_type == EQUALITY
    return data.efc_J.reshape(-1, model.nv)[own], data.efc_pos[own].copy()
