"""The verb `view`: the emulated robot live in a window, driven over its emulated bus.

    python -m sim2real run=view robot=quad8                            # along the motions of record
    python -m sim2real run=view robot=quad8 checkpoint=outputs/train/quad8_es/2026-11-21_10-00-00
    python -m sim2real run=view robot=quad8 checkpoint=RUN video=film  # no display: a film instead

What is seen is the robot that the driver talks to, hidden effects and all, not the model that the
policy was trained in; also while it is armed, goes to its start, and parks.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from hardware.backends import ServoBackend
from hardware.config import make_robot
from hardware.emulator.world import World
from hardware.excite import Kind
from hardware.rows import RobotRows
from sim2real.deployment.deploy import servo_task
from sim2real.deployment.trained import load_trained
from sim2real.deployment.view import (
    SETTLE,
    Window,
    along,
    by_policy,
    check_display,
    open_window,
    watch,
    write_film,
)
from sim2real.evaluation.films import Video
from sim2real.learning.algorithms.base import Algorithm, Parts
from sim2real.runs.errors import Sim2RealError


def run(
    *,
    parts: Parts,
    algorithm: Callable[..., Algorithm],
    checkpoint: str | list[str] | None,
    robot: dict[str, Any],
    stops: dict[str, float] | None,
    motions: list[Kind],
    seconds: float,
    video: Video | None,
    seed: int,
    out: Path,
) -> Path | None:
    """Show the emulated robot.

    Args:
        parts: what trains the policy: environment, tasks, transforms, policy, adaptation, ...; like
            the algorithm, a checkpoint's own unless something else was chosen.
        algorithm: makes the algorithm from its parts.
        checkpoint: the policy that drives the robot; None drives it along `motions`.
        robot: as conf/robot/NAME.yaml holds it.
        stops: when the guard stops the robot; see `deploy`.
        motions: kinds of motion, one after the other; see `hardware.excite`.
        seconds: how long, of the robot's time [s].
        video: the film to write instead of opening a window; None for the window.
        seed: of starts and motions.
        out: the run's folder; a film is videos/robot.mp4.

    Returns:
        The film, if there is one.

    Raises:
        Sim2RealError: a real robot, no time, or no display.
        RenderError: when nothing can be drawn on this machine.
    """
    machine = make_robot(robot)
    if machine.port is not None:
        raise Sim2RealError(f"view shows emulated robots; {machine.name} is at {machine.port}")
    if not seconds > 0:
        raise Sim2RealError(f"seconds={seconds} must be above 0")
    if video is None:
        check_display()
    drive = along(machine, motions, seconds, seed)
    if checkpoint is not None:
        task = servo_task(parts.environment)
        RobotRows(task, ServoBackend(machine, SETTLE))  # refuses another robot's policy at once
        trained = load_trained(checkpoint, parts, algorithm)
        drive = by_policy(task, trained, seed)
    world = World(machine, seed=seed)
    if video is None:
        with open_window(world) as handle:
            watch(world, Window(handle), seconds, drive, stops)
        return None
    return write_film(world, video, seconds, drive, stops, Path(out) / "videos" / "robot.mp4")
