"""The verb `record`: drive a robot along motions, or let it follow a leader, and write a log."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hardware.excite import Kind
from hardware.log import Log
from sim2real.deployment.record import draw, prepare_robot, record_motions
from sim2real.deployment.stops import make_stop_limits
from sim2real.deployment.teleoperate import prepare_leader, record_following


def run(
    *,
    robot: dict[str, Any],
    port: str | list[str] | None,
    calibration: str | None,
    arm: bool,
    motions: Sequence[Kind],
    seconds: float,
    size: float,
    stops: dict[str, float] | None,
    leader: str | None,
    leader_port: str | None,
    leader_calibration: str | None,
    leader_scale: Sequence[str],
    seed: int,
    out: Path,
) -> Log:
    """Record one episode.

    Args:
        robot: the content of conf/robot/NAME.yaml.
        port: its serial port, or those of its buses; None for its own, or the emulated robot.
        calibration: zeros, signs and limits as `python -m hardware calibrate` wrote them.
        arm: whether a real robot may move.
        motions: kinds of motion, one after the other; see `hardware.excite`.
        seconds: the duration of all of them, shared evenly.
        size: part of the way from where the robot is to the nearer limit that is used, in (0, 1].
        stops: when the guard stops the robot, where it differs from `hardware.safety.StopLimits`.
        leader: a robot that a person moves and this one follows, by its name or path; None drives
            along the motions. An emulated person moves an emulated leader along them.
        leader_port: the leader's serial port; None for its own, or the emulated one.
        leader_calibration: the leader's zeros, signs and limits.
        leader_scale: joints whose place in their travel is handed over, not their angle.
        seed: the seed of phases, poses and sizes.
        out: the run's folder; gets log.csv (log.csv.part until it is whole), log.json and
            plots/log.png.

    Returns:
        The log.

    Raises:
        Sim2RealError: a real robot that was not armed, no time to move in, a size out of range.
        LogError: the folder has a log.
        HardwareError: a robot that is wrong, is not there, or stopped on the way; the rows until
            then are in log.csv, whose metadata say why.
    """
    limits = make_stop_limits(stops)
    machine = prepare_robot(robot, port, calibration, arm, seconds, size)
    rng, path = np.random.default_rng(seed), Path(out) / "log.csv"
    if leader is None:
        log = record_motions(machine, motions, seconds, rng, path, size, limits=limits)
    else:
        ahead = prepare_leader(leader, leader_port, leader_calibration, machine)
        log = record_following(
            machine, ahead, leader_scale, motions, seconds, rng, path, size, limits=limits
        )
    draw(log, machine, Path(out) / "plots" / "log.png")
    return log
