"""The motion at a start, from the readings around it, and how unsure it is.

    moved, speed, unsure = motion_at(time, values, row, after, late)

Readings are a Taylor polynomial of third degree and white noise. How large accelerations and jerks
are is seen in the readings around: the mean square of their second and third differences, less what
noise makes of it, whose own size is that of the fourth. With these as prior variances of its
coefficients the polynomial is a Bayesian linear regression (Rasmussen and Williams 2006, section
2.1): slow motion is averaged as by a line, and fast motion is followed.
"""

from functools import lru_cache
from math import comb, factorial
from typing import NamedTuple

import mujoco
import numpy as np

from sim2real.diagnosis.settings import TINY

NEAR = 2  # rows on either side that the polynomial is fitted to
AROUND = 50  # rows on either side that show how large accelerations and jerks are
MOVING = 2, 3  # orders of differences: acceleration and jerk
NOISY = 4  # order of differences that are noise's
QUATERNION = 4
KEPT = 4096  # regressions that are kept


class Motion(NamedTuple):
    """How joints move at a moment near to their readings, (V,) each."""

    moved: np.ndarray  # since the reading [m or rad]
    speed: np.ndarray  # m/s or rad/s
    unsure: np.ndarray  # the standard deviation of speed


def motion_at(
    time: np.ndarray, values: np.ndarray, row: int, after: float = 0.0, late: float = 0.0
) -> Motion:
    """Return a joint's motion as the engine counts it; V is 1, 3 or 6.

    That of a free or ball joint is measured from its orientation in that row, in its own frame.

    Args:
        time: of the readings [s], (n,).
        values: of the joint, (n, D): a position, or a pose whose quaternion comes last.
        row: of the reading.
        after: the moment that is asked for, since that reading [s].
        late: how long before its positions a model's velocities are those of its motion [s].
    """
    first = max(row - AROUND, 0)
    own = (np.ascontiguousarray(part[first : row + AROUND + 1], float) for part in (time, values))
    speed, bend, unsure = _regress(*(part.tobytes() for part in own), row - first)
    moved = speed * after + bend * after**2 / 2
    return Motion(moved, speed + bend * (after - late), unsure)


@lru_cache(KEPT)
def _regress(time: bytes, values: bytes, row: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return speed, acceleration and how unsure the speed is, (V,) each, of readings around a row.

    Windows are cut anew from each mended log, whose other columns are the same.
    """
    times = np.frombuffer(time)
    places = np.frombuffer(values).reshape(len(times), -1)
    step = max(float(np.median(np.diff(times))), TINY)
    moved = _relative(places[:-1], places[1:])
    noise, *scales = _variances(moved)  # (V,) each, of a row's step
    near = slice(max(row - NEAR, 0), row + NEAR + 1)
    since = (times[near] - times[row]) / step
    readings = _relative(np.broadcast_to(places[row], places[near].shape), places[near])
    terms = np.stack([since**k / factorial(k) for k in range(NOISY)], axis=1)
    free = np.zeros_like(noise)
    prior = np.stack([free, free, *((noise + TINY**2) / (own + TINY**2) for own in scales)], axis=1)
    inverse = np.linalg.inv(terms.T @ terms + prior[:, None] * np.eye(prior.shape[1]))
    found = np.einsum("vab,nb,nv->va", inverse, terms, readings)
    return found[:, 1] / step, found[:, 2] / step**2, np.sqrt(noise * inverse[:, 1, 1]) / step


def _variances(moved: np.ndarray) -> list[np.ndarray]:
    """Return the variances of noise, acceleration and jerk, (V,) each, of steps (n, V)."""
    orders = (NOISY, *MOVING)
    steps = [np.diff(moved, order - 1, axis=0) for order in orders]
    squares = [np.square(own).sum(axis=0) / max(len(own), 1) for own in steps]
    noise = squares[0] / comb(2 * NOISY, NOISY)
    scales = zip(orders[1:], squares[1:], strict=True)
    return [noise, *(np.maximum(own - comb(2 * n, n) * noise, 0.0) for n, own in scales)]


def _relative(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return what leads from some positions or poses, (n, D), to others, (n, V)."""
    places = other.shape[1]
    if places < QUATERNION:
        return other - one
    turns = np.zeros((len(one), 3))
    for turn, before, after in zip(turns, one, other, strict=True):
        mujoco.mju_subQuat(turn, after[-QUATERNION:], before[-QUATERNION:])
    return np.concatenate([other[:, :-QUATERNION] - one[:, :-QUATERNION], turns], axis=1)
