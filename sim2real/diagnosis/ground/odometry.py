"""How fast and how high a base is, from soles that stand still on the ground.

    walk = walked(time, feet, felt, flight, settings)
    walk.speed, walk.height                     # (T, n) m/s, (T,) m above where `feet` had it

A sole that touches the ground does not move along its normal, and not across it unless it slips.
Which soles touch follows from their gaps, which slip from what the others say (iteratively
reweighted least squares with Cauchy's weights). Between rows the base moves as its accelerometer
says, else as in free flight while nothing touches, else smoothly.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solveh_banded

from sim2real.diagnosis.ground.feet import Feet
from sim2real.diagnosis.settings import Ground

PRIOR = 1e-3  # weight of 0 [s²/m² of speeds, 1/m² of heights]: far below that of any sole


class Walk(NamedTuple):
    """A base along T rows."""

    speed: np.ndarray  # (T, n) m/s of its linear positions
    height: np.ndarray  # (T,) m above where the soles' gaps were measured
    touch: np.ndarray  # (T, F) from 0 (in the air) to 1 (on the ground)
    slip: np.ndarray  # (T, F) m/s of each sole across the ground
    unsure: np.ndarray  # (T, n) m/s, standard deviation of the speed; grows while no sole stands


def walked(
    time: np.ndarray, feet: Feet, felt: np.ndarray | None, flight: np.ndarray, settings: Ground
) -> Walk:
    """Return how a base moves along the rows of an episode.

    Args:
        time: of the rows [s], (T,).
        feet: what the soles do.
        felt: the base's acceleration that an accelerometer says, gravity taken out [m/s²], (T, n).
        flight: that of free flight, (n,).
        settings: how sure each of it is.
    """
    step = np.diff(time)
    height = _carried(time, -feet.gap.min(axis=1), float(flight @ feet.up))
    touch = slip = np.zeros(feet.gap.shape)
    speed = np.zeros((len(time), len(flight)))
    curve, stiff = np.zeros((*speed.shape, len(flight))), np.ones(len(step))
    for _ in range(settings.rounds):
        above = np.maximum(feet.gap + height[:, None], 0.0)
        touch = np.exp(-((above / settings.gap_m) ** 2))
        still = touch / (1.0 + (slip / settings.slip_m_s) ** 2)
        pushed, doubt = _pushed(touch, felt, flight, settings)
        curve, down = _standing(feet, touch, still, settings)
        stiff = 1.0 / (doubt * step) ** 2  # (T - 1,)
        speed = _chained(curve, down, stiff, pushed * step[:, None])
        height = _heights(step, feet, speed, still, settings)
        moving = feet.drift + np.einsum("tfin,tn->tfi", feet.way, speed)
        across = moving - (moving @ feet.normal)[..., None] * feet.normal
        slip = np.linalg.norm(across, axis=2)
    unsure = np.hypot(_spread(curve, stiff), settings.slip_m_s)  # slower slip is unseen
    return Walk(speed, height, touch, slip, unsure)


def _pushed(
    touch: np.ndarray, felt: np.ndarray | None, flight: np.ndarray, settings: Ground
) -> tuple[np.ndarray, np.ndarray]:
    """Return accelerations of the base between rows [m/s²], (T - 1, n), and how sure, (T - 1,)."""
    if felt is not None:
        return (felt[1:] + felt[:-1]) / 2, np.full(len(touch) - 1, settings.felt_m_s2)
    ground = np.minimum(touch[:-1].sum(axis=1), 1.0)
    doubt = (1 - ground) * settings.felt_m_s2 + ground * settings.stance_m_s2
    return (1 - ground)[:, None] * flight, doubt


def _carried(time: np.ndarray, lowest: np.ndarray, fall: float) -> np.ndarray:
    """Return heights (T,) of a base that the ground pushes and never pulls.

    Where the lowest sole would have to leave the ground more slowly than the base falls, the base
    flies; it lands where its soles meet the ground again.
    """
    height, climb = lowest.copy(), 0.0
    for k in range(1, len(time)):
        step = time[k] - time[k - 1]
        flown = height[k - 1] + climb * step + fall * step**2 / 2
        if flown > lowest[k]:
            height[k], climb = flown, climb + fall * step
        else:
            climb = (lowest[k] - height[k - 1]) / step
    return height


def _standing(
    feet: Feet, touch: np.ndarray, still: np.ndarray, settings: Ground
) -> tuple[np.ndarray, np.ndarray]:
    """Return what soles say of the base's speed: X'X, (T, n, n), and X'y, (T, n)."""
    along = np.outer(feet.normal, feet.normal)
    weight = still[..., None, None] * (np.eye(3) - along) + touch[..., None, None] * along
    weight /= settings.sole_m_s**2  # (T, F, 3, 3)
    curve = np.einsum("tfin,tfij,tfjm->tnm", feet.way, weight, feet.way)
    return curve, -np.einsum("tfin,tfij,tfj->tn", feet.way, weight, feet.drift)


def _heights(
    step: np.ndarray, feet: Feet, speed: np.ndarray, still: np.ndarray, settings: Ground
) -> np.ndarray:
    """Return the height of each row (T,), from touching soles and the speed between rows."""
    climb = speed @ feet.up  # (T,) m/s along the normal
    rise = (climb[1:] + climb[:-1]) / 2 * step
    weight = still / settings.sole_m**2
    curve, down = weight.sum(axis=1), -(weight * feet.gap).sum(axis=1)
    stiff = np.full(len(rise), 1.0 / settings.sole_m**2)
    return _chained(curve[:, None, None], down[:, None], stiff, rise[:, None])[:, 0]


def _chained(
    curve: np.ndarray, down: np.ndarray, stiff: np.ndarray, gain: np.ndarray
) -> np.ndarray:
    """Return the n numbers of each row, (T, n), that leave the least square.

    Args:
        curve: what each row says of its own: X'X, (T, n, n).
        down: X'y of it, (T, n).
        stiff: weight of each step between rows, (T - 1,).
        gain: the numbers' change in each step, (T - 1, n).
    """
    count, size = down.shape
    blocks, right = curve + PRIOR * np.eye(size), down.copy()
    for rows, sign in ((slice(1, None), 1.0), (slice(-1), -1.0)):
        blocks[rows] += stiff[:, None, None] * np.eye(size)
        right[rows] += sign * stiff[:, None] * gain
    banded = np.zeros((size + 1, count * size))  # the upper half of a block-tridiagonal matrix
    for row in range(size):
        for column in range(row, size):
            banded[size - (column - row), column::size] = blocks[:, row, column]
    banded[0, size:] = np.repeat(-stiff, size)
    return solveh_banded(banded, right.ravel()).reshape(count, size)


def _spread(curve: np.ndarray, stiff: np.ndarray) -> np.ndarray:
    """Return the standard deviations of what `_chained` finds, (T, n).

    What is known of a row comes from its own soles, from all rows before it and from all after it.
    """
    own = curve + PRIOR * np.eye(curve.shape[1])
    every = own.copy()
    for order in (slice(None), slice(None, None, -1)):
        blocks, linked = own[order], np.zeros_like(own)
        for k, link in enumerate(stiff[order]):
            known = np.linalg.inv(blocks[k] + linked[k])
            linked[k + 1] = np.linalg.inv(known + np.eye(len(known)) / link)
        every += linked[order]
    return np.sqrt(np.diagonal(np.linalg.inv(every), axis1=1, axis2=2))
