"""A robot as the page's script moves it: its bodies, joints and shapes as plain numbers.

    skeleton(model)      # {"bodies": [...], "shapes": [...]}, for JSON

The script computes where each body is from the joints' positions, as `mj_kinematics` does, and
draws it flat. Hinges and slides move; a free or ball joint stays where the keyframe `home` has it,
since a report compares the joints and not where the robot stands.
"""

from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from sim2real.diagnosis.report import robot_drawing

DIGITS = 5  # of metres and quaternions: a hundredth of a millimetre
MOVED = {int(mujoco.mjtJoint.mjJNT_HINGE): "hinge", int(mujoco.mjtJoint.mjJNT_SLIDE): "slide"}
MOST = 400  # shapes: a page is no viewer of meshes


def skeleton(model: mujoco.MjModel) -> dict[str, Any]:
    """Return bodies (parents first, the world left out), their joints, and the shapes on them.

    Returns:
        `bodies`: parent (-1 the world), position, quaternion (w first) and joints, each with name,
        kind, axis, anchor and the value at which the body is as given. `shapes`: body, points in
        its frame (1 of a sphere, 2 of a capsule, else corners), radius [m].
    """
    home = robot_drawing.at_home(model)
    bodies = [_body(model, home, number) for number in range(1, model.nbody)]
    shapes = [
        {"body": body - 1, "points": _rounded(points), "radius": radius}
        for _, body, points, radius in robot_drawing.outlines(model)
    ]
    return {"bodies": bodies, "shapes": shapes[:MOST]}


def _body(model: mujoco.MjModel, home: mujoco.MjData, number: int) -> dict[str, Any]:
    joints = np.flatnonzero(model.jnt_bodyid == number).tolist()
    moved = [j for j in joints if int(model.jnt_type[j]) in MOVED]
    parent = int(model.body_parentid[number])
    own = {
        "parent": parent - 1,
        "position": _rounded(model.body_pos[number]),
        "turn": _rounded(model.body_quat[number]),
        "joints": [_joint(model, home, j) for j in moved],
    }
    if moved != joints:  # free or ball: as it stands at home, seen from the world or its parent
        base, here = (Rotation.from_matrix(home.xmat[i].reshape(3, 3)) for i in (parent, number))
        place = base.inv().apply(home.xpos[number] - home.xpos[parent])
        turn = (base.inv() * here).as_quat(scalar_first=True)
        own |= {"position": _rounded(place), "turn": _rounded(turn)}
    return own


def _joint(model: mujoco.MjModel, home: mujoco.MjData, joint: int) -> dict[str, Any]:
    address = int(model.jnt_qposadr[joint])
    return {
        "name": model.joint(joint).name,
        "kind": MOVED[int(model.jnt_type[joint])],
        "axis": _rounded(model.jnt_axis[joint]),
        "anchor": _rounded(model.jnt_pos[joint]),
        "zero": float(model.qpos0[address]),
        "home": float(home.qpos[address]),
    }


def _rounded(values: np.ndarray) -> Any:
    return np.round(np.asarray(values, float), DIGITS).tolist()
