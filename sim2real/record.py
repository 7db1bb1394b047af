"""The verb `record`: drive a robot along motions that show what it is like, and write a log.

    python -m sim2real run=record robot=bench1                       # the emulated robot
    python -m sim2real run=record robot=bench1 robot.hidden=effects.yaml motions=[ramp,swing]
    python -m sim2real run=record robot=bench1 port=/dev/ttyUSB0 calibration=bench1.json arm=true

Without a port the same bytes go to an emulated bus whose servos move a MuJoCo robot. A real robot
moves only with `arm=true`; torque is off again when the motion, or anything else, ends it.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hardware.calibration import apply_calibration, read_calibration
from hardware.config import Robot, make_robot
from hardware.connect import make_driver
from hardware.excite import Kind, excite
from hardware.log import Log, write_log
from hardware.record import joint_names, record
from hardware.safety import Guard
from sim2real.errors import Sim2RealError
from sim2real.plots import COLOURS, INK, figure

log_ = logging.getLogger(__name__)


def run(
    *,
    robot: dict[str, Any],
    port: str | None,
    calibration: str | None,
    arm: bool,
    motions: Sequence[Kind],
    seconds: float,
    seed: int,
    out: Path,
) -> Log:
    """Record one episode.

    Args:
        robot: as conf/robot/NAME.yaml holds it.
        port: its serial port; None for the robot's own, or else the emulated robot.
        calibration: zeros, signs and limits as `python -m hardware calibrate` wrote them.
        arm: whether a real robot may move.
        motions: kinds of motion, one after the other; see `hardware.excite`.
        seconds: of all of them, shared evenly.
        seed: of phases, poses and sizes.
        out: the run's folder; gets log.csv, log.json and plots/log.png.

    Returns:
        The log.

    Raises:
        Sim2RealError: a real robot that was not armed, or no time to move in.
        HardwareError: a robot that is wrong, is not there, or stopped on the way.
    """
    if not seconds > 0:
        raise Sim2RealError(f"seconds={seconds} must be above 0")
    machine = make_robot({**robot, **({"port": port} if port else {})})
    if machine.port is not None and not arm:
        raise Sim2RealError(
            f"{machine.name} at {machine.port} would move; clear the space around it, then "
            "add arm=true"
        )
    if calibration is not None:
        machine = apply_calibration(machine, read_calibration(calibration))
    log = drive(machine, motions, seconds, np.random.default_rng(seed))
    path = write_log(Path(out) / "log.csv", log)
    draw(log, machine, Path(out) / "plots" / "log.png")
    log_.info("%d rows in %s", len(log), path)
    return log


def drive(robot: Robot, motions: Sequence[Kind], seconds: float, rng: np.random.Generator) -> Log:
    """Connect, arm, move from where the robot is, and let go."""
    driver = make_driver(robot)
    try:
        driver.connect()
        driver.configure()
        with Guard(driver) as guard:
            pose = np.clip(guard.arm().position, guard.low, guard.high)
            return record(guard, excite(robot, pose, seconds, motions, rng))
    finally:
        driver.close()


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
