"""Whether a robot's limits are those of its model's joints: encoders of several turns take any.

check_ranges(robot, model)              # RobotError: the limits, the joint's range, what to do
"""

import math

import mujoco

from hardware.errors import RobotError
from hardware.robot import Robot

BEYOND = math.pi  # rad: a zero that is off by more than half a turn is another one


def check_ranges(robot: Robot, model: mujoco.MjModel) -> None:
    """Refuse limits that lead more than half a turn out of a hinge's range.

    Raises:
        RobotError: with the limits, the range in the model, and the limits that degrees would mean.
    """
    for servo in robot.servos:
        joint = model.joint(int(model.actuator(servo.name).trnid[0]))
        (low, high), (least, most) = servo.position, joint.range
        bounded = joint.type[0] == mujoco.mjtJoint.mjJNT_HINGE and model.jnt_limited[joint.id]
        if bounded and not least - BEYOND <= low < high <= most + BEYOND:
            raise RobotError(
                f"{robot.name}: servos.{servo.name}: position [{low:g}, {high:g}]; in {robot.model}"
                f" the joint {joint.name!r} has the range {least:.4g} to {most:.4g} rad. Narrow "
                f"it, or correct the model; angles are in rad ({low:g}° to {high:g}° are "
                f"{math.radians(low):.4g} to {math.radians(high):.4g} rad)"
            )
