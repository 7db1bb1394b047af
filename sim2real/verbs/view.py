"""The verb `view`: the emulated robot live in a window, driven over its emulated bus.

What is seen is the robot that the driver talks to, hidden effects and all, not the model that the
policy was trained in.
"""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from envs.effects import load_effects
from hardware.backends import ServoBackend
from hardware.config import make_robot
from hardware.emulator.world import EmulatedRobot
from hardware.excite import Kind
from hardware.log import read_logs
from hardware.rows import RobotRows
from sim2real.deployment.deploy import servo_task
from sim2real.deployment.trained import load_trained
from sim2real.deployment.view import (
    SETTLE,
    Window,
    check_display,
    motion_driver,
    open_window,
    policy_driver,
    watch,
    write_film,
)
from sim2real.diagnosis.data.recording import load_model
from sim2real.diagnosis.data.replay import measure_all
from sim2real.diagnosis.report.rerun_log import write_rerun
from sim2real.evaluation.videos import Video
from sim2real.learning.algorithms.base import Algorithm, Components
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)


def run(
    *,
    parts: Components,
    algorithm: Callable[..., Algorithm],
    checkpoint: str | list[str] | None,
    robot: dict[str, Any],
    stops: dict[str, float] | None,
    motions: list[Kind],
    seconds: float,
    video: Video | None,
    log: str | list[str] | None,
    model: str | None,
    effects: str | None,
    viewer: Literal["rerun"] | None,
    seed: int,
    out: Path,
) -> Path | None:
    """Show the emulated robot, or a log next to its simulation.

    Args:
        parts: what trains the policy: environment, tasks, transforms, policy, adaptation, ...; like
            the algorithm, a checkpoint's own unless something else was chosen.
        algorithm: makes the algorithm from its parts.
        checkpoint: the policy that drives the robot; None drives it along `motions`.
        robot: the content of conf/robot/NAME.yaml.
        stops: when the guard stops the robot; see `deploy`.
        motions: kinds of motion, one after the other; see `hardware.excite`.
        seconds: how long, of the robot's time [s].
        video: the film to write instead of opening a window; None for the window.
        log: a log to show instead, in a viewer of recordings.
        model: its MJCF; None: the model that it names.
        effects: an effects.yaml; the log is then also simulated with it.
        viewer: the viewer of a log: rerun. None for the emulated robot.
        seed: the seed of starts and motions.
        out: the run's folder; a film is videos/robot.mp4, a recording log.rrd.

    Returns:
        The film or recording, if there is one.

    Raises:
        Sim2RealError: a real robot, no time, or no display.
        RenderError: when nothing can be drawn on this machine.
    """
    if log is not None or viewer is not None:
        return show_log(log, model, effects, viewer, Path(out))
    machine = make_robot(robot)
    if machine.port is not None:
        raise Sim2RealError(f"view shows emulated robots; {machine.name} is at {machine.port}")
    if not seconds > 0:
        raise Sim2RealError(f"seconds={seconds} must be above 0")
    if video is None:
        check_display()
    drive = motion_driver(machine, motions, seconds, seed)
    if checkpoint is not None:
        task = servo_task(parts.environment)
        RobotRows(task, ServoBackend(machine, SETTLE))  # refuses another robot's policy at once
        trained = load_trained(checkpoint, parts, algorithm)
        drive = policy_driver(task, trained, seed)
    world = EmulatedRobot(machine, seed=seed)
    if video is None:
        with open_window(world) as handle:
            watch(world, Window(handle), seconds, drive, stops)
        return None
    path = Path(out) / "videos" / "robot.mp4"
    return write_film(world, (video.width, video.height), video.fps, seconds, drive, stops, path)


def show_log(
    log: str | list[str] | None,
    model: str | None,
    effects: str | None,
    viewer: str | None,
    out: Path,
) -> Path:
    """Write a log with its simulation, and with effects if they are given, for a viewer.

    Raises:
        Sim2RealError: a viewer without a log or a log without a viewer.
    """
    if log is None or viewer is None:
        raise Sim2RealError("log= and viewer= belong together: give both log=PATH and viewer=rerun")
    logs = read_logs(log)
    specs = [load_model(one, model) for one in logs]
    specs = [specs[0]] * len(logs)
    found = {"model as given": measure_all(logs, specs)}
    if effects is not None:
        found["with effects"] = measure_all(logs, specs, load_effects(effects))
    path = write_rerun(out / "log.rrd", found, specs[0])
    log_.info("open it with: rerun %s", path)
    return path
