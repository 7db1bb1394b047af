"""How a base without an IMU is turned: it rests on three soles or more, on level ground.

    turn = leant(model, base, qpos, settings)   # (T, 4) quaternions; None where it does not rest

The soles that carry a resting robot span a triangle that has all other soles above it and the
centre of mass over it. Its plane is the ground. Robots that walk fast, or stand on fewer soles, do
not rest.
"""

from itertools import combinations

import mujoco
import numpy as np

from sim2real.diagnosis.ground.base import Base, rotations
from sim2real.diagnosis.ground.turns import uprighted
from sim2real.diagnosis.settings import Ground

CORNERS = 3  # of what carries a robot


def leant(
    model: mujoco.MjModel, base: Base, qpos: np.ndarray, settings: Ground
) -> np.ndarray | None:
    """Return orientations of the base with heading 0, w first, (T, 4); None if it does not rest.

    Args:
        model: the robot.
        base: a free one.
        qpos: poses whose base stands as in the model, (T, nq).
        settings: in how many rows the centre of mass must be over the soles.
    """
    if len(base.soles) < CORNERS:
        return None
    data, ups, rests = mujoco.MjData(model), [], []
    upright = rotations(qpos[0, base.turn]).inv().apply([0.0, 0.0, 1.0])
    for pose in qpos:
        data.qpos[:] = pose
        data.qpos[base.turn] = np.eye(len(base.turn))[0]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        centre = data.subtree_com[base.body]
        up, margin = _carried(data.geom_xpos[base.soles], centre, upright, settings)
        ups.append(up)
        rests.append(margin > -settings.lean_margin)
    if np.mean(rests) < settings.rests:
        return None
    return uprighted(np.array(ups)).as_quat(scalar_first=True)


def _carried(
    soles: np.ndarray, centre: np.ndarray, upright: np.ndarray, settings: Ground
) -> tuple[np.ndarray, float]:
    """Return the normal (3,) of what carries a robot, and how far inside its centre of mass is.

    Only normals near to `upright` count: no robot lies on its back. The latter is the least of
    three barycentric coordinates: a third at most, negative outside.
    """
    best = upright, -np.inf
    for corners in combinations(range(len(soles)), CORNERS):
        one, two, three = soles[list(corners)]
        normal = np.cross(two - one, three - one)
        size = float(np.linalg.norm(normal))
        if size < settings.narrow_m2:
            continue
        normal = normal * np.sign(normal @ (centre - one) or 1.0) / size
        falls = normal @ upright < np.cos(settings.lean_most)
        if falls or ((soles - one) @ normal < -settings.gap_m).any():
            continue
        edges = np.column_stack([two - one, three - one, normal])
        along = np.linalg.solve(edges, centre - one)
        margin = float(min(along[0], along[1], 1.0 - along[0] - along[1]))
        if margin > best[1]:
            best = normal, margin
    return best
