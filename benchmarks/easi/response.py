"""How joints answer their commands: on a robot that hangs on a stand, and in simulations of it.

    record(robot, Path("stand"), seed=0)
    real, shown = measured(Path("stand")), simulated(Path("stand"), distribution, rows=30, seed=0)
    tracking(real, shown), apart(real, shown)      # (n,) rad, (n,)

Simulations are replays of the same commands from the same start.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.signal import csd, welch

from envs.distribution import Distribution
from envs.effects import Effect
from envs.plant import Plant
from envs.replay import replay, switchable
from hardware.config import Robot
from hardware.excite import FAST, SLOW, Kind
from hardware.log import Log, read_logs
from hardware.safety import StopLimits
from sim2real.diagnosis.data.recording import load_model, to_recording
from sim2real.loops.improve.steps import on_stand

SECONDS = 24.0  # of the recording
MOTIONS: tuple[Kind, ...] = ("chirp", "multisine")
GROUND = "ground_friction"
WINDOW = 256  # rows of a piece of the spectrum
LIMITS = StopLimits(odd_voltage=0.4, stray=2.0)  # legs that give are no fault


class Answer(NamedTuple):
    """What joints were told and where they went."""

    command: np.ndarray  # (T, M) rad
    angle: np.ndarray  # (n, T, M) rad: n simulations, or one robot
    rate: float  # rows a second


def record(robot: Robot, folder: Path, seed: int) -> None:
    """Drive a robot on its stand along a chirp and many sines, unless that was done."""
    on_stand(robot, folder, MOTIONS, SECONDS, LIMITS, np.random.default_rng(seed), seed)


def log_of(folder: Path) -> Log:
    """Return the first recording of a stand."""
    return read_logs(folder / "a.csv")[0]


def measured(folder: Path) -> Answer:
    """Return what the robot on the stand did."""
    log = log_of(folder)
    angle = np.column_stack([log.column(f"qpos.{name}") for name in log.actuators])
    return Answer(commands(log), angle[None], rate(log))


def simulated(folder: Path, distribution: Distribution, rows: int, seed: int) -> Answer:
    """Return what draws of a distribution make of the same commands."""
    values = distribution.sample(np.random.default_rng(seed), rows)
    return played(folder, distribution.effects, values)


def played(folder: Path, effects: tuple[Effect, ...], values: np.ndarray) -> Answer:
    """Return what simulations with parameters (n, P), one an effect, make of the commands.

    A robot in the air has no ground: that effect is left out.
    """
    kept = [i for i, effect in enumerate(effects) if effect.name != GROUND]
    effects, values = tuple(effects[i] for i in kept), values[:, kept]
    log = log_of(folder)
    plant = Plant(switchable(load_model(log, None)), effects, num_rows=len(values))
    plant.set_params(np.arange(len(values)), values)
    model = plant.model
    joints = [int(model.joint(name).qposadr[0]) for name in log.actuators]
    paths = replay(plant, [to_recording(log, model)] * len(values), joints)
    return Answer(commands(log), np.stack(paths), rate(log))


def commands(log: Log) -> np.ndarray:
    """Return the commands of all servos, (T, M)."""
    return np.column_stack([log.column(f"ctrl.{name}") for name in log.actuators])


def rate(log: Log) -> float:
    """Return rows a second."""
    return 1.0 / float(np.median(np.diff(log.time)))


def response(answer: Answer) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies (F,) [Hz] of a chirp, and how angles follow commands there, (n, F).

    Complex: the mean over joints of the cross spectrum over the commands' own.
    """
    command = answer.command.T  # (M, T)
    angle = np.moveaxis(answer.angle, 1, 2)  # (n, M, T)
    frequency, own = welch(command, answer.rate, nperseg=WINDOW)
    _, cross = csd(np.broadcast_to(command, angle.shape), angle, answer.rate, nperseg=WINDOW)
    inside = (frequency >= SLOW) & (frequency <= FAST)
    return frequency[inside], (cross / own)[..., inside].mean(axis=1)


def tracking(real: Answer, shown: Answer) -> np.ndarray:
    """Return how far simulated angles are from the robot's, root mean square, (n,) [rad]."""
    return np.sqrt(np.mean((shown.angle - real.angle) ** 2, axis=(1, 2)))


def apart(real: Answer, shown: Answer) -> np.ndarray:
    """Return how far simulated frequency responses are from the robot's, mean distance, (n,)."""
    return np.abs(response(shown)[1] - response(real)[1]).mean(axis=1)
