"""The speed at a start, from the readings around it, and how unsure it is.

    speed, unsure = speed_at(time, values, row, late)

Readings are a Taylor polynomial of third degree and white noise. How large accelerations and jerks
are is seen in the readings around: the mean square of their second and third differences, less what
noise makes of it, whose own size is that of the fourth. With these as prior variances of its
coefficients the polynomial is a Bayesian linear regression (Rasmussen and Williams 2006, section
2.1): slow motion is averaged as by a line, and fast motion is followed.
"""

from math import comb, factorial

import mujoco
import numpy as np

from sim2real.diagnosis.settings import TINY

NEAR = 2  # rows on either side that the polynomial is fitted to
AROUND = 50  # rows on either side that show how large accelerations and jerks are
MOVING = 2, 3  # orders of differences: acceleration and jerk
NOISY = 4  # order of differences that are noise's
QUATERNION = 4


def speed_at(
    time: np.ndarray, values: np.ndarray, row: int, late: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return a joint's velocity in a row as the engine counts it, and its standard deviation.

    That of a free or ball joint is measured from its orientation in that row, in its own frame.

    Args:
        time: of the readings [s], (n,).
        values: of the joint, (n, D): a position, or a pose whose quaternion comes last.
        row: in which the velocity is asked for.
        late: how long before its positions a model's velocities are those of its motion [s].

    Returns:
        Both of shape (V,), V being 1, 3 or 6.
    """
    some = slice(max(row - AROUND, 0), row + AROUND + 1)
    step = max(float(np.median(np.diff(time[some]))), TINY)
    moved = _relative(values[some][:-1], values[some][1:])
    noise, *scales = _variances(moved)  # (V,) each, of a row's step
    near = slice(max(row - NEAR, 0), row + NEAR + 1)
    since = (time[near] - time[row]) / step
    readings = _relative(np.broadcast_to(values[row], values[near].shape), values[near])
    terms = np.stack([since**k / factorial(k) for k in range(NOISY)], axis=1)
    free = np.zeros_like(noise)
    prior = np.stack([free, free, *((noise + TINY**2) / (own + TINY**2) for own in scales)], axis=1)
    inverse = np.linalg.inv(terms.T @ terms + prior[:, None] * np.eye(prior.shape[1]))
    found = np.einsum("vab,nb,nv->va", inverse, terms, readings)
    speed = found[:, 1] / step - found[:, 2] / step**2 * late
    return speed, np.sqrt(noise * inverse[:, 1, 1]) / step


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
