"""The logs of an exam: the emulated robot, with what it hides, driven through the real driver.

    robot = exam_robot("quad8", folder)             # on a stand; writes folder/model.xml
    made = plans(robot, seed=7)                     # a, b, a_again and held
    log = drive(robot, [{"effect": "backlash", "where": None, "value": 0.02}], made["a"], seed=1)

Robots with legs hang on a stand: what no servo drives is fixed, nothing touches the ground. The
model given with the logs is the nominal one that the robot's user has: position actuators with
gain, torque limit and back-EMF from the data sheet, and the robot's declared bus delay. The robot
itself is `hardware.emulator`, whose laws, time step and timing are its own. Its clock is virtual: a
log of 24 s takes about one.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hardware.config import Robot, load_robot
from hardware.connect import make_driver
from hardware.emulator.hidden import make_hidden
from hardware.emulator.world import EmulatedRobot
from hardware.excite import ExcitationPlan, Kind, excite
from hardware.log import Log
from hardware.record import record
from hardware.safety import Guard, StopLimits
from hardware.stand import home_pose, write_stand_model

TOLERANT = StopLimits(odd_voltage=1.0, stray=2.0)  # a hidden effect must not stop the recording
MOTIONS: tuple[Kind, ...] = ("ramp", "chirp", "steps", "multisine", "hold", "swing")
# Nobody lets go of an arm that would fall; letting go of eight servos one by one takes 20 ms.
NEVER_LIMP = ("arm6", "quad8", "quad12")
SECONDS = 24.0  # of each motion
AGAIN = 8.0  # s of the first one that are driven twice: what noise does
MEET = 1.0  # s after which robots that start from different poses follow the same motion
SIZE = 0.5  # part of the way to the limits that the motions use

Entries = Sequence[Mapping[str, Any]]


def exam_robot(name: str, folder: Path) -> Robot:
    """Write the nominal model into a folder and return the robot with it.

    Raises:
        RobotError: there is no such robot.
    """
    return write_stand_model(load_robot(name), folder)


def motions(robot: Robot) -> list[Kind]:
    """Return the kinds of motion that a robot is driven along; some are never let go."""
    return [kind for kind in MOTIONS if kind != "swing" or robot.name not in NEVER_LIMP]


def plans(robot: Robot, seed: int) -> dict[str, ExcitationPlan]:
    """Return the motions: two whole ones, the first one's beginning again, one to be held back."""
    kinds, pose = motions(robot), home_pose(robot)
    made = {
        name: excite(robot, pose, SECONDS, kinds, np.random.default_rng(s), SIZE)
        for name, s in zip(("a", "b", "held"), np.random.SeedSequence(seed).spawn(3), strict=True)
    }
    rows = round(AGAIN * robot.rate)
    made["a_again"] = ExcitationPlan(made["a"].angles[:rows], made["a"].torque[:rows])
    return made


def drive(robot: Robot, entries: Entries, plan: ExcitationPlan, seed: int) -> Log:
    """Record one motion of the emulated robot that hides these effects.

    Args:
        robot: a robot from `exam_robot`.
        entries: entries of an effects.yaml.
        plan: the motion.
        seed: the seed of the bus's timing and the sensors' noise.

    Raises:
        HardwareError: the robot was stopped on the way: it swung out of its limits, or a servo
            switched itself off.
    """
    world = EmulatedRobot(robot, hidden=make_hidden(list(entries), robot), seed=seed)
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
    """Return the joints' RMS differences between two recordings of one motion [rad], (n,).

    Not of the first second, in which robots that stood differently meet: a replay starts where the
    robot stood, and has no gap there.
    """
    names = [f"qpos.{joint}" for joint in one.joints]
    rows = slice(int(np.searchsorted(one.time, one.time[0] + MEET)), min(len(one), len(other)))
    apart = [one.column(name)[rows] - other.column(name)[rows] for name in names]
    return np.sqrt(np.mean(np.square(apart), axis=1))


def overall(joints: np.ndarray) -> float:
    """Return the RMS over joints of their RMS differences, (n,)."""
    return float(np.sqrt(np.mean(np.square(joints))))
