"""Steps of a loop, each of which leaves a folder and is not done again where that is there.

on_stand(robot, folder / "stand", motions, 24.0, limits, rng, seed=0)     # two recordings
effects = diagnosed(read_logs(folder / "stand"), None, 0, folder / "diagnosis")
trained = learn(folder, "corrected", parts.with_effects(effects), settings)
"""

import logging
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from envs.effects.file import FILE
from hardware.config import Robot
from hardware.errors import SafetyError
from hardware.excite import Kind
from hardware.log import Log
from hardware.safety import StopLimits
from hardware.stand import home_pose, write_stand_model
from sim2real.deployment.record import record_motions
from sim2real.diagnosis.data.progress import Progress
from sim2real.diagnosis.diagnose import run_diagnosis
from sim2real.diagnosis.outcome import write
from sim2real.diagnosis.report import text
from sim2real.learning.algorithms.base import Components
from sim2real.learning.trained import TrainedPolicy
from sim2real.learning.training import train
from sim2real.runs.checkpoint import FOLDER, find, read_metadata
from sim2real.runs.errors import RunInterrupted
from sim2real.runs.files import atomic_folder

log_ = logging.getLogger(__name__)
LOGS = ("a", "b")  # recordings on the stand
BROKEN_OFF = "_stopped"  # what the folder of recordings is called that the guard ended


def learn(
    folder: Path,
    name: str,
    parts: Components,
    settings: dict[str, Any],
    start: str | Path | None = None,
) -> TrainedPolicy:
    """Train in a separate folder, from where it stopped, and return the policy.

    Args:
        folder: of the loop.
        name: of the folder in it.
        parts: what the policy is trained with.
        settings: further arguments of `train`.
        start: a checkpoint whose policy the training goes on from; None for a new one.

    Raises:
        RunInterrupted: after Ctrl-C; its message says how to continue.
    """
    place = folder / name
    begun = any((place / FOLDER).glob("checkpoint-*"))
    try:
        learner = train(
            parts=parts,
            **settings,
            cluster=None,
            resume=place if begun else None,
            start=start,
            out=place,
        )
    except RunInterrupted as stopped:
        text = f"stopped while it trained {name}; continue with resume={folder}"
        raise RunInterrupted(text, stopped.exit_code) from None
    return replace(learner.trained(), source=find(place))


def longer(settings: dict[str, Any], source: Path) -> dict[str, Any]:
    """Return the settings of a training that adds its budget to what a checkpoint has spent."""
    done = read_metadata(source)
    more = {"iterations": done["iteration"], "frames": done["frames"]}
    return settings | {k: settings[k] and int(settings[k]) + int(n) for k, n in more.items()}


def on_stand(
    robot: Robot,
    folder: Path,
    motions: Sequence[Kind],
    seconds: float,
    limits: StopLimits,
    rng: np.random.Generator,
    seed: int,
) -> None:
    """Record a robot on a stand twice, unless the folder is there.

    Args:
        robot: the robot; a real one hangs.
        folder: gets the model of the robot on its stand, a.csv and b.csv; what a guard that stops
            the robot leaves is in a folder next to it.
        motions: kinds of motion.
        seconds: the duration of each recording.
        limits: when the guard stops the robot.
        rng: the random generator of the motions.
        seed: the seed of an emulated robot's noise.

    Raises:
        SafetyError: the robot was stopped on the way.
    """
    if folder.is_dir():
        return
    with atomic_folder(folder) as place:
        hanging = write_stand_model(robot, place)
        pose = home_pose(hanging)
        for number, name in enumerate(LOGS):
            path = place / f"{name}.csv"
            own = {"pose": pose, "limits": limits, "seed": seed + number}
            try:
                record_motions(hanging, motions, seconds, rng, path, **own)
            except SafetyError:
                os.replace(place, _free(folder))
                raise


def _free(folder: Path) -> Path:
    """Return an unused name next to a folder."""
    number, path = 1, folder.with_name(folder.name + BROKEN_OFF)
    while path.exists():
        number += 1
        path = folder.with_name(f"{folder.name}{BROKEN_OFF}_{number}")
    return path


def diagnosed(
    logs: Sequence[Log],
    known: Path | None,
    seed: int,
    folder: Path,
    progress: Progress | None = None,
) -> Path:
    """Diagnose logs, unless the folder is there, and return the file of what was found.

    Args:
        logs: each names its model.
        known: an effects.yaml of what the simulator has already; None for nothing.
        seed: the seed of the bootstrap.
        folder: gets all files of the diagnosis. Logs that contradict themselves leave no file of
            effects.
        progress: called with what is being tried and the share of the work that is done.
    """
    if not folder.is_dir():
        found = run_diagnosis(list(logs), None, known, (), seed, progress)
        with atomic_folder(folder) as place:
            write(found, place)
        log_.info("%s", text.verdict_sentence(found.report))
    return folder / FILE
