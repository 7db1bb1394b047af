"""How a base without an IMU is turned: it rests on three soles or more, on level ground.

    turn = leant(model, base, qpos, settings)   # (T, 4) quaternions; None where it does not rest

The soles that carry a resting robot span a triangle that has all other soles above it and the
centre of mass over it. Its plane is the ground. Robots that walk fast, or stand on fewer soles, do
not rest.
"""

from collections.abc import Iterator
from itertools import combinations

import mujoco
import numpy as np
from scipy.spatial.distance import pdist

from sim2real.diagnosis.ground.base import Base, posed, rotations
from sim2real.diagnosis.ground.turns import uprighted
from sim2real.diagnosis.settings import TINY, Ground

CORNERS = 3  # of what carries a robot


def leant(
    model: mujoco.MjModel, base: Base, qpos: np.ndarray, settings: Ground
) -> np.ndarray | None:
    """Return orientations of the base with heading 0, w first, (T, 4); None if it does not rest.

    Args:
        model: the robot.
        base: a free one.
        qpos: poses whose base stands as in the model, (T, nq).
        settings: in how many rows the centre of mass may be elsewhere than over the soles.
    """
    if len(base.soles) < CORNERS:
        return None
    ups, rests, poses = [], [], qpos.copy()
    poses[:, base.turn] = np.eye(len(base.turn))[0]
    upright = rotations(qpos[0, base.turn]).inv().apply([0.0, 0.0, 1.0])
    for data in posed(model, poses):
        every = _carried(data.geom_xpos[base.soles], data.subtree_com[base.body], settings)
        up = max(every, key=lambda normal: normal @ upright, default=-upright)
        rests.append(up @ upright > 0)  # no robot lies on its back
        ups.append(up)
    if np.mean(rests) < 1 - settings.told_share:
        return None
    return uprighted(np.array(ups)).as_quat(scalar_first=True)


def _carried(soles: np.ndarray, centre: np.ndarray, settings: Ground) -> Iterator[np.ndarray]:
    """Yield the upward normals (3,) of the planes on which soles (F, 3) carry a robot."""
    for corners in combinations(soles, CORNERS):
        one, two, three = corners
        normal, longest = np.cross(two - one, three - one), max(pdist(corners))
        size = float(np.linalg.norm(normal))
        if size < settings.gap_m * longest:
            continue  # as narrow as soles are unsure: a line
        normal = normal * np.sign(normal @ (centre - one) or 1.0) / size
        if ((soles - one) @ normal < -settings.gap_m).any():
            continue
        across = np.linalg.solve(np.column_stack([two - one, three - one, normal]), centre - one)
        if min(across[0], across[1], 1.0 - across[0] - across[1]) > -TINY:  # over the triangle
            yield normal
