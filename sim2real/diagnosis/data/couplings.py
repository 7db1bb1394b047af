"""Where joints that nobody logged stand, if gears and rods couple them to those of a log.

    qpos, qvel = follow_couplings(model, qpos, qvel, logged)

A model says couplings as equality constraints: of two joints, of tendons, of two bodies. Its
unlogged joints are moved until the residuals r of all of them vanish, by Gauss-Newton steps with
the engine's Jacobian J = [J_known J_free]; speeds fulfil J qvel = 0. A replay that started in the
middle of a motion with a gear as it stood at home would begin with its snap.
"""

from collections.abc import Collection

import mujoco
import numpy as np

EQUALITY = int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
DENSE = int(mujoco.mjtJacobian.mjJAC_DENSE)
ROUNDS = 10
CLOSED = 1e-9  # m or rad: residuals that are rounding


def follow_couplings(
    model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray, logged: Collection[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Return a start whose unlogged joints are where the model's couplings put them.

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
    data, kind = mujoco.MjData(model), model.opt.jacobian
    data.qpos[:], moved, left = qpos, np.zeros(model.nv), []
    model.opt.jacobian = DENSE
    try:
        for _ in range(ROUNDS):
            mujoco.mj_fwdPosition(model, data)
            coupled = data.efc_type == EQUALITY
            slopes = data.efc_J.reshape(-1, model.nv)[coupled]  # (E, nv)
            left.append(float(np.abs(data.efc_pos[coupled]).max(initial=0.0)))
            if left[-1] < CLOSED:
                break
            moved[dofs] = -np.linalg.pinv(slopes[:, dofs]) @ data.efc_pos[coupled]
            mujoco.mj_integratePos(model, data.qpos, moved, 1.0)
    finally:
        model.opt.jacobian = kind
    if left[-1] > left[0]:  # nothing fulfils them from here
        return qpos, qvel
    qvel, known = qvel.copy(), np.setdiff1d(np.arange(model.nv), dofs)
    qvel[dofs] = -np.linalg.pinv(slopes[:, dofs]) @ (slopes[:, known] @ qvel[known])
    return data.qpos.copy(), qvel
