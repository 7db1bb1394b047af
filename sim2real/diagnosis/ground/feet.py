"""What the soles of a robot do while its base is where the model has it: gaps and speeds.

    feet = feet_of(model, base, qpos, qvel)     # (T, nq), (T, nv) with a base that stays
    feet.gap                                    # (T, F) m above the ground

A base that moves by u changes the speed of each sole by `way @ u`, one that is h higher each gap
by h.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from sim2real.diagnosis.ground.base import Base, posed

FAR = 10.0  # m: soles farther from the ground are nowhere near it


class Feet(NamedTuple):
    """F soles in T rows, with the base's linear positions as in the first pose and at rest."""

    gap: np.ndarray  # (T, F) m between sole and ground, negative inside
    drift: np.ndarray  # (T, F, 3) m/s of each sole's nearest point, by joints and turns
    way: np.ndarray  # (T, F, 3, n) what the base's n linear speeds add to it
    normal: np.ndarray  # (3,) of the ground
    up: np.ndarray  # (n,) m that each of the base's linear positions raises it by

    @property
    def lift(self) -> np.ndarray:
        """What of the base's linear positions raises it by 1 m, (n,)."""
        return self.up / max(float(self.up @ self.up), np.finfo(float).tiny)


def feet_of(model: mujoco.MjModel, base: Base, qpos: np.ndarray, qvel: np.ndarray) -> Feet:
    """Return what the soles do in poses (T, nq) at speeds (T, nv)."""
    shape = len(qpos), len(base.soles)
    gap, drift = np.zeros(shape), np.zeros((*shape, 3))
    way = np.zeros((*shape, 3, len(base.dofs)))
    jacobian, ends = np.zeros((3, model.nv)), np.zeros(6)
    normal = _normal(model, base)
    for k, data in enumerate(posed(model, qpos)):
        for i, sole in enumerate(base.soles.tolist()):
            gap[k, i] = mujoco.mj_geomDistance(model, data, base.floor, sole, FAR, ends)
            body = int(model.geom_bodyid[sole])
            mujoco.mj_jac(model, data, jacobian, None, ends[3:], body)
            drift[k, i] = jacobian @ qvel[k]
            way[k, i] = jacobian[:, base.dofs]
    up = normal @ way[0, 0]  # (n,): slides and free joints move all soles alike
    return Feet(gap, drift, way, normal, up)


def _normal(model: mujoco.MjModel, base: Base) -> np.ndarray:
    """Return the ground's upward direction: a plane's own, else against gravity."""
    if model.geom_type[base.floor] == mujoco.mjtGeom.mjGEOM_PLANE:
        data = next(posed(model, model.qpos0[None]))
        return data.geom_xmat[base.floor].reshape(3, 3)[:, 2].copy()
    down = model.opt.gravity
    return -down / max(float(np.linalg.norm(down)), np.finfo(float).tiny)
