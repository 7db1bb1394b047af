"""Joints that no actuator drives, and whether a robot's logs can tell where they are.

why = refusal(model, has_imu=False)     # "moves at root, which no servo reads, and ..."; or None
"""

import mujoco

from envs.effects.contact import ground, soles
from envs.effects.places import driven_joints
from envs.models import FREE

SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)


def unobservable_joints_message(model: mujoco.MjModel, has_imu: bool) -> str | None:
    """Return which joints of a robot no servo reads and why they cannot be estimated, or None.

    Args:
        model: with the ground that the robot stands on.
        has_imu: whether one on its base is logged.
    """
    driven = driven_joints(model)
    loose = {j: int(model.jnt_type[j]) for j in range(model.njnt) if j not in driven}
    why = ""
    if not loose:
        return None
    if not (ground(model).size and soles(model).size):
        why = "its model has no ground to stand on"
    elif not set(loose.values()) <= {FREE, SLIDE}:
        why = "only a free base and the slides of a boom are estimated from its feet"
    elif FREE in loose.values() and not has_imu:
        why = "no IMU says how it is turned (imu: in the robot's file)"
    names = ", ".join(model.joint(j).name for j in loose)
    return f"moves at {names}, which no servo reads, and {why}" if why else None
