"""The robots of the exam: their models, what else is known of them, and how they are built.

    robot = ROBOTS["arm3"]
    rig = make_rig(robot)                           # what its model describes, in another engine
    nominal(robot).to_xml()                         # the model that is given to a diagnosis
    ctrl = plan(robot, seconds=24, rng=rng)         # (T, n): angles, or torques of a leg

The nominal model is what an honest user has: gains, limits, inertia and friction of the data sheet,
and in its actuators the delay that was measured once: the bus's and half a tick of the firmware.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from hardware.stand import delay
from sim2real.exam.thirdparty.bus import Bus
from sim2real.exam.thirdparty.engines import EngineName
from sim2real.exam.thirdparty.friction import Friction
from sim2real.exam.thirdparty.motion import motion
from sim2real.exam.thirdparty.rig import Joint, Rig
from sim2real.exam.thirdparty.servo import Servo
from sim2real.exam.thirdparty.tree import read_tree

ASSETS = Path(__file__).parents[3] / "envs" / "assets" / "exam"
STEP = 0.0005  # s of physics
REACH = 1.0  # rad that a leg swings to each side
HELD = (60.0, 2.0)  # N·m/rad and N·m·s/rad with which a program makes a leg follow angles


@dataclass(frozen=True)
class Robot:
    """A robot's properties that its model lacks."""

    name: str  # of the robot and of its MJCF in envs/assets/exam
    rate: float  # control steps a second
    firmware: float = 2000.0  # ticks of the servos' loops a second
    latency: float = 0.001  # of commands on the bus [s]
    age: float = 0.0001  # of readings when their row's command is written [s]
    jitter: float = 0.0001  # half the spread of both [s]
    counts: float = 4096.0  # of an encoder's turn, as the program reads it


ROBOTS: Mapping[str, Robot] = {
    robot.name: robot
    for robot in (Robot("pendulum", rate=100), Robot("arm3", rate=100), Robot("leg2", rate=200))
}


def nominal(robot: Robot) -> mujoco.MjSpec:
    """Return the model that a user of the robot has."""
    spec = mujoco.MjSpec.from_file(str(ASSETS / f"{robot.name}.xml"))
    delay(spec, robot.latency + 0.5 / robot.firmware)
    return spec


def make_rig(robot: Robot, engine: EngineName = "drake") -> Rig:
    """Return the robot that its model describes.

    Args:
        robot: its actuators are position servos or motors without a gear ratio, one a joint, each
            of its joint's name.
        engine: what moves it.
    """
    model = nominal(robot).compile()
    tree = read_tree(model)
    joints = {name: joint_of(model, name) for name in tree.names}
    bus = Bus(robot.latency, robot.age, robot.jitter, robot.counts)
    sites = {
        model.body(int(model.site_bodyid[i])).name: model.site_pos[i] for i in range(model.nsite)
    }
    ends = {body: np.array(place) for body, place in sites.items()}
    home = dict(zip(tree.names, model.key("home").qpos.tolist(), strict=True))
    return Rig(tree, joints, bus, robot.rate, robot.firmware, engine, STEP, home, ends)


def plan(robot: Robot, seconds: float, rng: np.random.Generator) -> np.ndarray:
    """Return commands of a motion, (T, n): angles [rad]; of motors the torques for them [N·m].

    Torques are what a program's loop asks of a robot that hides nothing: a log replays them.
    """
    model = nominal(robot).compile()
    home = model.key("home").qpos
    rig = make_rig(robot)
    if not any(joint.servo and joint.servo.torque for joint in rig.joints.values()):
        low, high = model.actuator_ctrlrange.T
        return motion(low, high, home, robot.rate, seconds, rng)
    angles = motion(home - REACH, home + REACH, home, robot.rate, seconds, rng)
    kp, kd = HELD
    for name in rig.driven:
        rig = rig.servo(name, torque=False, kp=kp, kd=kd)
    held = replace(rig, bus=replace(rig.bus, jitter=0.0, counts=2.0**24)).drive(angles, seed=0)
    seen = np.column_stack([held.column(f"qpos.{name}") for name in rig.driven])
    speed = np.gradient(seen, 1 / robot.rate, axis=0)
    low, high = model.actuator_ctrlrange.T
    return np.clip(kp * (angles - seen) - kd * speed, low, high)


def joint_of(model: mujoco.MjModel, name: str) -> Joint:
    """Return a model's values of a joint and of the actuator of its name."""
    dof, actuator = int(model.joint(name).dofadr[0]), model.actuator(name).id
    gain, bias = model.actuator_gainprm[actuator], model.actuator_biasprm[actuator]
    servo = Servo(
        kp=-float(bias[1]),
        kd=-float(bias[2]),
        limit=float(model.actuator_forcerange[actuator, 1]),
        torque=bool(bias[1] == 0 and gain[0] == 1),
        braking=float(model.actuator_damping[actuator]),
    )
    rubs = Friction(float(model.dof_frictionloss[dof]), float(model.dof_damping[dof]))
    armature = float(model.dof_armature[dof] + model.actuator_armature[actuator])
    return Joint(servo, rubs, armature, float(model.dof_M0[dof]))
