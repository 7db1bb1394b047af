"""A robot on a stand: what no servo drives is fixed, and nothing touches the ground.

    robot = hung(load_robot("quad8"), folder)       # its model is folder/model.xml now

What is recorded there shows servos and links without the chaos of contacts. The model is the
nominal one that the robot's user has: position actuators with gain, torque limit and back-EMF from
the data sheet, and the robot's declared bus delay in its actuators. An arm, which stands anyway,
only gets the delay.
"""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from hardware.config import Robot
from hardware.files import atomic_write

MODEL = "model.xml"
CLEARANCE = 0.3  # m that a stand lifts a robot above its place
LINEAR = 1  # the engine's number for linear interpolation of a delay line


def write_stand_model(robot: Robot, folder: Path) -> Robot:
    """Write the model of the robot on its stand into a folder and return the robot with it."""
    spec = on_stand(mujoco.MjSpec.from_file(str(robot.model)))
    delay(spec, robot.command_delay)
    spec.compile()
    path = folder / MODEL
    with atomic_write(path) as temporary:
        temporary.write_text(spec.to_xml(), encoding="utf-8")
    return replace(robot, model=path)


def on_stand(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return the robot with every joint fixed that no actuator drives, in the air if it walks.

    In a model with equalities or tendons, actuators may drive joints through them: there only
    the joints of the base are fixed.
    """
    spec = spec.copy()
    model = spec.copy().compile()
    driven = {actuator.target for actuator in spec.actuators}
    loose = [joint for joint in spec.joints if joint.name not in driven]
    if spec.equalities or spec.tendons:  # gears and rods hang on servos: the base alone is loose
        loose = [joint for joint in loose if joint.parent.parent.name == "world"]
    if not loose:
        return spec
    home = angles_at_home(model)
    for name in {joint.parent.name for joint in loose if joint.parent.parent.name == "world"}:
        spec.body(name).pos[2] += CLEARANCE
    for joint in loose:
        spec.delete(joint)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    for key in list(spec.keys):
        spec.delete(key)
    bare = spec.copy().compile()
    qpos = [home[bare.joint(i).name] for i in range(bare.njnt)]
    spec.add_key(name="home", qpos=qpos, ctrl=[home[a.target] for a in spec.actuators])
    return spec


def angles_at_home(model: mujoco.MjModel) -> dict[str, float]:
    """Return each hinge's and slide's position in the keyframe `home`."""
    qpos = model.key("home").qpos
    single = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return {
        model.joint(i).name: float(qpos[model.jnt_qposadr[i]])
        for i in range(model.njnt)
        if int(model.jnt_type[i]) in single
    }


def home_pose(robot: Robot) -> np.ndarray:
    """Return the pose of the keyframe `home`, within the robot's limits, (n,) [rad]."""
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    home = angles_at_home(model)
    targets = {model.actuator(i).name: model.actuator_trnid[i, 0] for i in range(model.nu)}
    pose = [home[model.joint(int(targets[name])).name] for name in robot.names]
    low, high = np.array([servo.position for servo in robot.servos]).T
    return np.clip(pose, low, high)


def delay(spec: mujoco.MjSpec, seconds: float) -> None:
    """Delay the actuators' commands by this time [s], and let a longer delay interpolate too."""
    for actuator in spec.actuators:
        actuator.delay = seconds
        actuator.nsample = int(np.ceil(seconds / spec.option.timestep)) + 1
        actuator.interp = LINEAR
