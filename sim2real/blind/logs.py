"""The logs of an exam: the emulated robot, with what it hides, driven through the real driver.

    robot = exam_robot("quad8", folder)             # on a stand; writes folder/model.xml
    made = plans(robot, seed=7)                     # a, b, a_again and held
    log = drive(robot, [{"effect": "backlash", "where": None, "value": 0.02}], made["a"], seed=1)

Robots with legs hang on a stand: what no servo drives is fixed, nothing touches the ground. The
model beside the logs is the honest nominal of the robot's user: position actuators with gain,
torque limit and back-EMF from the data sheet, and the robot's declared bus delay. The robot itself
is `hardware.emulator`, whose laws, time step and timing are its own. Its clock is virtual: a log of
24 s takes about one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from hardware.config import Robot, load_robot
from hardware.connect import make_driver
from hardware.emulator.hidden import make_hidden
from hardware.emulator.world import World
from hardware.excite import Kind, Plan, excite
from hardware.log import Log
from hardware.record import record
from hardware.safety import Guard, Policy
from sim2real.files import write_text

MODEL = "model.xml"
CLEARANCE = 0.3  # m that a stand lifts a robot above its place
LINEAR = 1  # the engine's number for linear interpolation of a delay line
TOLERANT = Policy(odd_voltage=1.0, stray=2.0)  # a hidden effect must not stop the recording
MOTIONS: tuple[Kind, ...] = ("ramp", "chirp", "steps", "multisine", "hold", "swing")
# Nobody lets go of an arm that would fall; letting go of eight servos one by one takes 20 ms.
NEVER_LIMP = ("arm6", "quad8")
SECONDS = 24.0  # of each motion
AGAIN = 8.0  # s of the first one that are driven twice: what noise does
SIZE = 0.5  # part of the way to the limits that the motions use

Entries = Sequence[Mapping[str, Any]]


def exam_robot(name: str, folder: Path) -> Robot:
    """Write the nominal model into a folder and return the robot with it.

    Raises:
        RobotError: there is no such robot.
    """
    robot = load_robot(name)
    spec = on_stand(mujoco.MjSpec.from_file(str(robot.model)))
    _delay(spec, robot.command_delay)
    spec.compile()
    path = write_text(folder / MODEL, spec.to_xml())
    return replace(robot, model=path)


def on_stand(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return the robot with every joint fixed that no actuator drives, in the air if it walks."""
    spec = spec.copy()
    model = spec.copy().compile()
    driven = {actuator.target for actuator in spec.actuators}
    loose = [joint for joint in spec.joints if joint.name not in driven]
    if not loose:
        return spec
    home = _home(model)
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


def _home(model: mujoco.MjModel) -> dict[str, float]:
    """Return each hinge's and slide's position in the keyframe `home`."""
    qpos = model.key("home").qpos
    single = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return {
        model.joint(i).name: float(qpos[model.jnt_qposadr[i]])
        for i in range(model.njnt)
        if int(model.jnt_type[i]) in single
    }


def _delay(spec: mujoco.MjSpec, delay: float) -> None:
    """Delay what actuators are told by this time [s], and let a longer delay interpolate too."""
    for actuator in spec.actuators:
        actuator.delay = delay
        actuator.nsample = int(np.ceil(delay / spec.option.timestep)) + 1
        actuator.interp = LINEAR


def plans(robot: Robot, seed: int) -> dict[str, Plan]:
    """Return the motions: two whole ones, the first one's beginning again, one to be held back."""
    kinds: list[Kind] = [
        kind for kind in MOTIONS if kind != "swing" or robot.name not in NEVER_LIMP
    ]
    made = {
        name: excite(robot, _middle(robot), SECONDS, kinds, np.random.default_rng(s), SIZE)
        for name, s in zip(("a", "b", "held"), np.random.SeedSequence(seed).spawn(3), strict=True)
    }
    rows = round(AGAIN * robot.rate)
    made["a_again"] = Plan(made["a"].angles[:rows], made["a"].torque[:rows])
    return made


def _middle(robot: Robot) -> np.ndarray:
    """Return the pose of the keyframe `home`, within the limits, (n,) [rad]."""
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    home = _home(model)
    targets = {model.actuator(i).name: model.actuator_trnid[i, 0] for i in range(model.nu)}
    pose = [home[model.joint(int(targets[name])).name] for name in robot.names]
    low, high = np.array([servo.position for servo in robot.servos]).T
    return np.clip(pose, low, high)


def drive(robot: Robot, entries: Entries, plan: Plan, seed: int) -> Log:
    """Record one motion of the emulated robot that hides these effects.

    Args:
        robot: as `exam_robot` returns it.
        entries: as in an effects.yaml.
        plan: the motion.
        seed: of the bus's timing and the sensors' noise.

    Raises:
        HardwareError: the robot was stopped on the way: it swung out of its limits, or a servo
            switched itself off.
    """
    world = World(robot, hidden=make_hidden(list(entries), robot), seed=seed)
    driver = make_driver(robot, world)
    try:
        driver.connect()
        driver.configure()
        with Guard(driver, TOLERANT) as guard:
            guard.arm()
            return record(guard, plan)
    finally:
        driver.close()


def difference(one: Log, other: Log) -> np.ndarray:
    """Return the joints' RMS differences between two recordings of one motion [rad], (n,)."""
    names = [f"qpos.{joint}" for joint in one.joints]
    rows = min(len(one), len(other))
    apart = [one.column(name)[:rows] - other.column(name)[:rows] for name in names]
    return np.sqrt(np.mean(np.square(apart), axis=1))


def overall(joints: np.ndarray) -> float:
    """Return the RMS over joints of their RMS differences, (n,)."""
    return float(np.sqrt(np.mean(np.square(joints))))
