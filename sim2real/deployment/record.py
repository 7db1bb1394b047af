"""A robot driven along motions that show what it is like.

    python -m sim2real run=record robot=bench1                       # the emulated robot
    python -m sim2real run=record robot=bench1 robot.hidden=effects.yaml motions=[ramp,swing]
    python -m sim2real run=record robot=bench1 port=/dev/ttyUSB0 calibration=bench1.json arm=true

Without a port the same bytes go to an emulated bus whose servos move a MuJoCo robot. A real robot
moves only with `arm=true`; torque is off again when the motion, or anything else, ends it.
"""

import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hardware.body import EmulatedBody
from hardware.calibration import apply_calibration, read_calibration
from hardware.config import Robot, make_robot
from hardware.connect import make_driver
from hardware.driver import Driver
from hardware.emulator.world import EmulatedRobot
from hardware.excite import Kind, allowed_motions, excite
from hardware.imu.reader import make_imu
from hardware.log import Log
from hardware.record import Recording, joint_names
from hardware.safety import Guard, StopLimits
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.figures import COLOURS, INK, figure

log_ = logging.getLogger(__name__)


def configure_robot(
    robot: dict[str, Any],
    port: str | list[str] | None,
    calibration: str | None,
    imu_port: str | None = None,
) -> Robot:
    """Return the robot of a configuration, at its ports, with its calibration.

    Raises:
        RobotError: a wrong robot's file, the calibration of another robot, or the port of an IMU
            that its file does not name.
    """
    machine = make_robot({**robot, **({"port": port} if port is not None else {})})
    if imu_port is not None:
        machine = machine.with_imu_at(imu_port)
    if calibration is not None:
        machine = apply_calibration(machine, read_calibration(calibration))
    return machine


def prepare_robot(
    robot: dict[str, Any],
    port: str | list[str] | None,
    calibration: str | None,
    arm: bool,
    seconds: float,
    size: float,
) -> Robot:
    """Return a robot that may be driven along motions.

    Args:
        robot: the content of conf/robot/NAME.yaml.
        port: its serial port, or those of its buses; None for its own, or the emulated robot.
        calibration: a file of `python -m hardware calibrate`; None for the robot's own zeros.
        arm: whether a real robot may move.
        seconds: how long it will.
        size: how far of the way to its limits.

    Raises:
        Sim2RealError: a real robot that was not armed, no time to move in, a size out of range.
        HardwareError: a robot or a calibration that is wrong.
    """
    if not seconds > 0:
        raise Sim2RealError(f"seconds={seconds} must be above 0")
    if not 0 < size <= 1:
        raise Sim2RealError(f"size={size} must be above 0 and at most 1")
    machine = configure_robot(robot, port, calibration)
    if machine.port is not None and not arm:
        raise Sim2RealError(
            f"{machine.name} at {machine.port} would move; clear the space around it, then "
            "add arm=true"
        )
    return machine


def record_motions(
    robot: Robot,
    motions: Sequence[Kind],
    seconds: float,
    rng: np.random.Generator,
    path: Path | None = None,
    size: float = 0.6,
    *,
    pose: np.ndarray | None = None,
    limits: StopLimits | None = None,
    seed: int = 0,
) -> Log:
    """Connect, arm, move about a pose, and let go.

    Args:
        robot: the robot.
        motions: kinds of motion; those that do not suit the robot are left out, see
            `allowed_motions`.
        seconds: the duration of all of them.
        rng: the random generator of phases, poses and sizes.
        path: where the log goes, row by row, also one that the guard, Ctrl-C or anything else
            ended early; None writes none.
        size: part of the way from the pose to the nearer limit that is used, in (0, 1].
        pose: the middle of the motion [rad], (n,), to which the robot goes slowly; None: where it
            is.
        limits: when the guard stops it.
        seed: the seed of an emulated robot's randomness.

    Raises:
        SafetyError: the robot was stopped on the way.
        HardwareError: a robot that is wrong, or is not there.
    """
    kinds = allowed_motions(robot, motions)

    def move(guard: Guard, recording: Recording) -> None:
        here = np.clip(guard.arm().position, guard.low, guard.high)
        middle = here if pose is None else pose
        guard.move_to(middle)  # also back from just outside the limits
        recording.drive(excite(robot, middle, seconds, kinds, rng, size))

    world = EmulatedRobot(robot, seed=seed) if robot.port is None else None
    return record_while(move, make_driver(robot, world), world, path, limits)


def record_while(
    move: Callable[[Guard, Recording], None],
    driver: Driver,
    world: EmulatedRobot | None,
    path: Path | None,
    limits: StopLimits | None,
) -> Log:
    """Connect, let a function move the robot, and let go.

    Args:
        move: arms the robot and moves it.
        driver: of the robot.
        world: the emulated robot, None for a real one.
        path: where the log goes, row by row; None writes none.
        limits: when the guard stops it.

    Raises:
        SafetyError: the robot was stopped on the way.
        HardwareError: a robot that is wrong, or is not there.
    """
    robot = driver.robot
    imu = make_imu(robot)
    emulated = EmulatedBody(world) if world is not None and robot.imu is not None else None
    guard = Guard(driver, limits)
    recording = Recording(guard, sensors=emulated or imu, path=path)
    try:
        if imu is not None:
            imu.open()
        driver.connect()
        driver.configure()
        with guard:
            move(guard, recording)
    finally:
        driver.close()
        if imu is not None:
            imu.close()
        if recording.close() and path is not None:
            log_.info("%d rows in %s; %s", len(recording), path.name, recording.link)
    return recording.log()


def draw(log: Log, robot: Robot, path: Path) -> None:
    """Draw what was commanded and what was measured, a row a joint."""
    pairs = list(zip(robot.names, joint_names(robot), strict=True))
    with figure(path, len(pairs), 1, (8.0, 1.0 + 1.9 * len(pairs))) as (_, axes):
        for panel, (name, joint) in zip(axes[:, 0], pairs, strict=True):
            panel.plot(log.time, log.column(f"ctrl.{name}"), color=COLOURS[0], label="commanded")
            panel.plot(log.time, log.column(f"qpos.{joint}"), color=INK, label="measured")
            panel.set_ylabel(f"{joint} (rad)")
        axes[0, 0].legend(loc="upper right")
        axes[-1, 0].set_xlabel("time (s)")
