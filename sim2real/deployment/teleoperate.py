"""A robot that follows a leader moved by a person, recorded as any other motion.

    sim2real record leader=so101_leader.yaml follower=so101 leader_port=/dev/ttyACM1 ...

Without ports both are emulated, and an emulated person moves the leader along `motions`.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hardware.calibration import apply_calibration, read_calibration
from hardware.clock import VirtualClock
from hardware.config import Robot, make_robot
from hardware.connect import make_driver
from hardware.emulator.world import EmulatedRobot
from hardware.excite import Kind, excite
from hardware.log import Log
from hardware.record import Recording
from hardware.robot_files import find_robot, read_robot
from hardware.safety import Guard, StopLimits
from hardware.stand import home_pose
from hardware.teleoperation import EmulatedPerson, Leader, check_joints
from sim2real.deployment.record import record_while
from sim2real.runs.errors import Sim2RealError

SPEED = 0.5  # rad/s at which the follower goes to where the leader is at the start


def prepare_leader(name: str, port: str | None, calibration: str | None, follower: Robot) -> Robot:
    """Return the leader of a robot.

    Args:
        name: a robot of conf/robot, or a path that ends in .yaml; where it leaves its model open,
            that of the follower is taken.
        port: its serial port; None for its own, or the emulated one.
        calibration: a file of `python -m hardware calibrate`; None for its own zeros.
        follower: the robot that follows it.

    Raises:
        Sim2RealError: one of both is emulated and the other is not, or they have the same port.
        RobotError: a leader that is wrong, or has other joints than the follower.
    """
    path = find_robot(name)
    data = read_robot(path)
    data["model"] = data.get("model") or str(follower.model)
    leader = make_robot({**data, **({"port": port} if port is not None else {})}, str(path))
    check_joints(leader, follower)
    if (leader.port is None) != (follower.port is None):
        at = [f"{robot.name} is {robot.port or 'emulated'}" for robot in (leader, follower)]
        raise Sim2RealError(f"{' and '.join(at)}: give leader_port= and port=, or neither")
    if leader.port is not None and leader.port == follower.port:
        raise Sim2RealError(
            f"leader and follower both have the port {leader.port}; give each its own"
        )
    if calibration is None:
        return leader
    return apply_calibration(leader, read_calibration(calibration))


def record_following(
    robot: Robot,
    leader: Robot,
    scaled: Sequence[str],
    motions: Sequence[Kind],
    seconds: float,
    rng: np.random.Generator,
    path: Path,
    size: float,
    *,
    limits: StopLimits | None = None,
    seed: int = 0,
) -> Log:
    """Let the robot follow its leader, and record it.

    Args:
        robot: the follower.
        leader: see `prepare_leader`.
        scaled: joints whose place in their travel is handed over; see `Leader`.
        motions: along which an emulated person moves an emulated leader.
        seconds: how long.
        rng: the random generator of the emulated person.
        path: where the log goes, row by row.
        size: of the emulated person's motions.
        limits: when the guard stops the follower.
        seed: the seed of the emulated robots' randomness.

    Raises:
        SafetyError: the follower was stopped on the way, also because the leader fell silent.
        HardwareError: a robot that is wrong, or is not there.
    """
    if robot.port is None:
        clock, world = VirtualClock(), EmulatedRobot(robot, seed=seed)
        own = EmulatedRobot(replace(leader, hidden=None), seed=seed)
        own.hold()
        drawn = excite(leader, home_pose(leader), seconds, motions, rng, size).angles
        person = EmulatedPerson(own, drawn, leader.rate, clock.now)
        driver = make_driver(robot, world, clock)
        ahead = Leader(make_driver(leader, own, clock), robot, scaled, person)
    else:
        world, driver = None, make_driver(robot)
        ahead = Leader(make_driver(leader), robot, scaled)

    def move(guard: Guard, recording: Recording) -> None:
        ahead.connect()
        guard.arm()
        guard.move_to(ahead.angles(), SPEED)
        recording.follow(ahead.angles, round(seconds * robot.rate))

    try:
        return record_while(move, driver, world, path, limits)
    finally:
        ahead.close()
