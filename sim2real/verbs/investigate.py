"""The verb `investigate`: record, diagnose, design the next recording, until causes are parted."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hardware.excite import Kind
from hardware.log import Log, read_log, read_logs
from sim2real.deployment.record import prepare_robot, record_motions
from sim2real.diagnosis.data.progress import ProgressLines
from sim2real.diagnosis.experiments.menu import Item
from sim2real.diagnosis.outcome import final_message
from sim2real.loops.investigate import WORDS, Investigation, SearchBudget, investigate

log_ = logging.getLogger(__name__)


def run(
    *,
    robot: dict[str, Any],
    port: str | list[str] | None,
    calibration: str | None,
    arm: bool,
    motions: Sequence[Kind],
    seconds: float,
    size: float,
    budget: float,
    log: str | list[str] | None,
    seed: int,
    out: Path,
) -> Investigation:
    """Investigate a robot.

    Args:
        robot: the content of conf/robot/NAME.yaml.
        port: its serial port, or those of its buses; None for its own, or the emulated robot.
        calibration: zeros, signs and limits as `python -m hardware calibrate` wrote them.
        arm: whether a real robot may move.
        motions: kinds of motion of the first recording; see `hardware.excite`.
        seconds: its duration.
        size: part of the way from where the robot is to the nearer limit that it uses, in (0, 1].
        budget: s of robot time in all.
        log: earlier recordings to start from; None: the first is recorded.
        seed: all randomness follows from it.
        out: the run's folder; gets recordings/, investigate.json, investigate.md and what
            `diagnose` writes.

    Returns:
        How it ended.

    Raises:
        Sim2RealError: a real robot that was not armed, a budget below one recording.
        HardwareError: a robot that is wrong, is not there, or stopped on the way; the rounds until
            then are written.
    """
    machine = prepare_robot(robot, port, calibration, arm, seconds, size)

    def record(item: Item, path: Path) -> Log:
        log_.info("recording %s, %g s", item.name, item.seconds)
        rng = np.random.default_rng(item.seed)
        record_motions(machine, item.motions, item.seconds, rng, path, item.size)
        return read_log(path)

    first = Item("all motions", tuple(motions), seconds, size, seed)
    found = investigate(
        machine,
        record,
        SearchBudget(budget),
        first,
        seed=seed,
        out=Path(out),
        logs=read_logs(log) if log else (),
        progress=ProgressLines(),
    )
    for words in final_message(found.report):
        log_.warning("%s", words)
    log_.info("%s", WORDS[found.end])
    return found
