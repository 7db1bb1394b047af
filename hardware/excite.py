"""Motions that show what a robot is like: what `record` drives along.

    rng = np.random.default_rng(0)
    plan = excite(robot, pose, seconds=20.0, kinds=("ramp", "chirp", "steps", "swing"), rng=rng)
    log = record(guard, plan)

Each kind shows something of its own:

    ramp        slow, to both ends and back: friction, play, dead zones, sag under load
    chirp       a sine from slow to fast: inertia, delay, damping, speed limits
    steps       jumps of several sizes, held: gains, limits of torque, current and speed
    multisine   many sines at once, each joint with its own: coupling, and everything a little
    hold        random poses, held: masses and their centres, gains, offsets
    swing       torque off for a while: friction alone, without the motor
"""

import logging
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple, get_args

import mujoco
import numpy as np

from hardware.config import Robot
from hardware.errors import RobotError, did_you_mean, format_names

_logger = logging.getLogger(__name__)

Kind = Literal["ramp", "chirp", "steps", "multisine", "hold", "swing"]
Wave = Callable[[np.ndarray, int, np.random.Generator], np.ndarray]
LONGEST = 86400.0  # s
FADE = 0.5  # s in which a motion grows from, and falls back to, the middle pose
SLOW, FAST = 0.2, 3.0  # Hz, the ends of a chirp
SWING = 0.4  # of a swing's time, that torque is off


class ExcitationPlan(NamedTuple):
    """Commands over time, and the servos whose torque is on."""

    angles: np.ndarray  # rad, (T, n)
    torque: np.ndarray  # bool, (T,)


def allowed_motions(robot: Robot, kinds: Sequence[Kind]) -> list[Kind]:
    """Return the kinds of motion that suit a robot: one that stands on its legs is never let go.

    Args:
        robot: its model says whether its base is free.
        kinds: the kinds wished for.

    Raises:
        RobotError: none of them suits.
    """
    model = mujoco.MjModel.from_xml_path(str(robot.model))
    free = bool((model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).any())
    if not free or "swing" not in kinds:
        return list(kinds)
    left: list[Kind] = [kind for kind in kinds if kind != "swing"]
    why = f"{robot.name} stands free and collapses when torque goes off"
    if not left:
        raise RobotError(f"{why}: swing needs a robot that hangs, and a model with a fixed base")
    _logger.warning("%s: swing is left out", why)
    return left


def excite(
    robot: Robot,
    pose: np.ndarray,
    seconds: float,
    kinds: Sequence[Kind],
    rng: np.random.Generator,
    size: float = 0.6,
) -> ExcitationPlan:
    """Make a motion of these kinds, one after the other, about a pose.

    Args:
        robot: its limits of position and velocity hold.
        pose: the middle of the motion [rad], (n,); each kind starts and ends there.
        seconds: the duration of the whole motion, shared evenly.
        kinds: see the module.
        rng: the random generator of phases, poses and sizes.
        size: part of the way from the pose to the nearer limit that is used, in (0, 1].

    Raises:
        RobotError: an unknown kind, a size or a time out of range, or a pose outside the limits.
    """
    for kind in kinds:
        if kind not in get_args(Kind):
            hint = did_you_mean(kind, get_args(Kind))
            raise RobotError(
                f"unknown motion {kind!r}{hint}; available: {format_names(get_args(Kind))}"
            )
    if not 0 < seconds <= LONGEST:
        raise RobotError(f"seconds={seconds:g}: a motion lasts up to {LONGEST:g} s (a day)")
    if not kinds or not 0 < size <= 1:
        raise RobotError(f"a motion needs kinds ({list(kinds)}) and a size in (0, 1], not {size}")
    low, high = np.array([servo.position for servo in robot.servos]).T
    pose = np.asarray(pose, float)
    if pose.shape != low.shape or ((pose < low) | (pose > high)).any():
        raise RobotError(f"the pose {pose} is not within the limits {low} to {high} rad")
    reach = size * np.minimum(pose - low, high - pose)  # (n,)
    fastest = np.array([servo.velocity for servo in robot.servos])
    steps = max(round(seconds * robot.rate / len(kinds)), 4)
    parts = [_part(kind, steps, robot.rate, reach, fastest, rng) for kind in kinds]
    return ExcitationPlan(
        pose + np.concatenate([angles for angles, _ in parts]),
        np.concatenate([torque for _, torque in parts]),
    )


def _part(
    kind: Kind,
    steps: int,
    rate: float,
    reach: np.ndarray,
    fastest: np.ndarray,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """One kind's offsets from the pose, (T, n), within reach and speed, and its torque, (T,)."""
    time = np.arange(steps) / rate
    torque = np.ones(steps, bool)
    if kind == "swing":
        torque = (time % 2.0 > 2.0 * (1 - SWING)) == 0
    waves = _WAVES[kind](time, len(reach), rng)  # (T, n) in [-1, 1]
    fade = np.clip(np.minimum(time, time[-1] - time) / FADE, 0, 1)
    offsets = waves * fade[:, None] * reach
    if kind not in ("steps", "hold", "swing"):
        speed = np.abs(np.diff(offsets, axis=0)).max(axis=0) * rate
        offsets = offsets * np.minimum(1, 0.9 * fastest / np.maximum(speed, 1e-9))
    return offsets, torque


def _ramp(time: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Triangles, two in the time, joints shifted against each other."""
    phase = 2 * time[:, None] / time[-1] + np.arange(n) / max(n, 1) / 2
    return 4 * np.abs((phase - 0.25) % 1 - 0.5) - 1


def _chirp(time: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Sines whose frequency grows evenly; joints start at different phases."""
    turns = SLOW * time + (FAST - SLOW) * time**2 / (2 * time[-1])
    return np.sin(2 * np.pi * (turns[:, None] + rng.uniform(0, 1, n)))


def _steps(time: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Jumps every 0.8 s to sizes in both directions."""
    return _held(time, n, 0.8, rng)


def _hold(time: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Poses held for 2 s."""
    return _held(time, n, 2.0, rng)


def _held(time: np.ndarray, n: int, span: float, rng: np.random.Generator) -> np.ndarray:
    values = rng.uniform(-1, 1, (int(time[-1] / span) + 1, n))
    return values[(time / span).astype(int)]


def _multisine(time: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    """Eight sines between the chirp's ends, scaled so that none leaves [-1, 1]."""
    rates = np.geomspace(SLOW, FAST, 8)[:, None] * rng.uniform(0.9, 1.1, (8, n))
    phases = rng.uniform(0, 2 * np.pi, (8, n))
    waves = np.sin(2 * np.pi * rates * time[:, None, None] + phases).sum(axis=1)
    return waves / np.abs(waves).max(axis=0)


_WAVES: dict[str, Wave] = {
    "ramp": _ramp,
    "chirp": _chirp,
    "steps": _steps,
    "multisine": _multisine,
    "hold": _hold,
    "swing": _hold,
}
