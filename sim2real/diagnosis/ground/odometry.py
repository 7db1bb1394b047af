"""How fast and how high a base is, from soles that stand still on the ground.

    walk = walked(time, feet, push, settings)
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
from sim2real.diagnosis.settings import TINY, Ground


class Push(NamedTuple):
    """What moves a base other than its soles: mean accelerations, and how far they may be off."""

    felt: np.ndarray | None  # (T, n) m/s² that the accelerometer says, gravity taken out
    flight: np.ndarray  # (n,) m/s² in free flight


class Walk(NamedTuple):
    """A base along T rows."""

    speed: np.ndarray  # (T, n) m/s of its linear positions
    height: np.ndarray  # (T,) m above where the soles' gaps were measured
    touch: np.ndarray  # (T, F) from 0 (in the air) to 1 (on the ground)
    slip: np.ndarray  # (T, F) m/s of each sole across the ground
    unsure: np.ndarray  # (T, n) m/s, standard deviation of the speed; grows while no sole is firm


def walked(time: np.ndarray, feet: Feet, push: Push, settings: Ground) -> Walk:
    """Return how a base moves along the rows of an episode.

    Args:
        time: of the rows [s], (T,).
        feet: what the soles do.
        push: what else is known.
        settings: how sure each of it is.
    """
    up = feet.lift / (feet.lift @ feet.lift)
    height = _carried(time, -feet.gap.min(axis=1), float(push.flight @ up), settings)
    slip = np.zeros(feet.gap.shape)
    speed = unsure = np.zeros((len(time), feet.way.shape[3]))
    touch = np.ones(feet.gap.shape)
    for _ in range(settings.rounds):
        above = np.maximum(feet.gap + height[:, None], 0.0)
        touch = np.exp(-((above / settings.gap_m) ** 2))
        still = touch / (1.0 + (slip / settings.slip_m_s) ** 2)
        speed, unsure = _speeds(time, feet, push, touch, still, settings)
        height = _heights(time, feet, speed, still, settings)
        moving = feet.drift + np.einsum("tfin,tn->tfi", feet.way, speed)
        across = moving - (moving @ feet.normal)[..., None] * feet.normal
        slip = np.linalg.norm(across, axis=2)
    firm = (touch / (1.0 + (slip / settings.slip_m_s) ** 2)).max(axis=1) > settings.stands
    adrift = _adrift(time, firm) * _pushed(touch, push, settings)[1]  # (T,) m/s
    return Walk(speed, height, touch, slip, np.hypot(unsure, adrift[:, None]))


def _adrift(time: np.ndarray, firm: np.ndarray) -> np.ndarray:
    """Return how far in time the nearest row with a firm sole is [s], (T,)."""
    if not firm.any():
        return np.full(len(time), float(np.ptp(time)))
    near = time[firm]
    after = np.searchsorted(near, time).clip(max=len(near) - 1)
    before = np.maximum(after - 1, 0)
    return np.minimum(np.abs(time - near[after]), np.abs(time - near[before]))


def _pushed(touch: np.ndarray, push: Push, settings: Ground) -> tuple[np.ndarray, np.ndarray]:
    """Return accelerations of the base [m/s²]: between rows, (T - 1, n), and how sure, (T,)."""
    if push.felt is not None:
        return (push.felt[1:] + push.felt[:-1]) / 2, np.full(len(touch), settings.felt_m_s2)
    ground = np.minimum(touch.sum(axis=1), 1.0)
    doubt = settings.flight_m_s2 + ground * (settings.stance_m_s2 - settings.flight_m_s2)
    return (1 - ground[:-1])[:, None] * push.flight, doubt


def _carried(time: np.ndarray, lowest: np.ndarray, fall: float, settings: Ground) -> np.ndarray:
    """Return heights (T,) of a base that the ground pushes and never pulls.

    Where the lowest sole would have to leave the ground more slowly than the base falls, the base
    flies; it lands where its soles meet the ground again.
    """
    height, climb = lowest.copy(), 0.0
    for k in range(1, len(time)):
        step = time[k] - time[k - 1]
        flown = height[k - 1] + climb * step + fall * step**2 / 2
        if flown > lowest[k] + settings.leave_m:
            height[k], climb = flown, climb + fall * step
        else:
            climb = (lowest[k] - height[k - 1]) / step
    return height


def _speeds(
    time: np.ndarray,
    feet: Feet,
    push: Push,
    touch: np.ndarray,
    still: np.ndarray,
    settings: Ground,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the speeds (T, n) that let soles stand, and their standard deviations."""
    along = feet.normal
    weight = still[..., None, None] * (np.eye(3) - np.outer(along, along))
    weight = weight + touch[..., None, None] * np.outer(along, along)
    weight = weight / settings.sole_m_s**2  # (T, F, 3, 3)
    curve = np.einsum("tfin,tfij,tfjm->tnm", feet.way, weight, feet.way)
    down = -np.einsum("tfin,tfij,tfj->tn", feet.way, weight, feet.drift)
    (pushed, doubt), step = _pushed(touch, push, settings), np.diff(time)
    stiff = 1.0 / (doubt[:-1] * step) ** 2  # (T - 1,)
    speed = _chained(curve, down, stiff, pushed * step[:, None], settings.prior)
    near = np.zeros_like(curve)  # what the neighbours say reaches a row through its stiffness
    for shift in (1, -1):
        other = np.roll(curve, shift, axis=0)
        link = np.roll(np.append(stiff, 0.0), max(shift, 0))[:, None, None]
        near += other * link / (link + np.trace(other, axis1=1, axis2=2)[:, None, None] + TINY)
    spread = np.linalg.inv(curve + near + settings.prior * np.eye(speed.shape[1]))
    return speed, np.sqrt(np.diagonal(spread, axis1=1, axis2=2))


def _heights(
    time: np.ndarray, feet: Feet, speed: np.ndarray, still: np.ndarray, settings: Ground
) -> np.ndarray:
    """Return the height of each row (T,), from touching soles and the speed between rows."""
    climb = speed @ (feet.lift / (feet.lift @ feet.lift))  # (T,) m/s along the normal
    rise = (climb[1:] + climb[:-1]) / 2 * np.diff(time)
    weight = still / settings.sole_m**2
    curve, down = weight.sum(axis=1), -(weight * feet.gap).sum(axis=1)
    stiff = np.full(len(rise), 1.0 / settings.sole_m**2)
    return _chained(curve[:, None, None], down[:, None], stiff, rise[:, None], settings.prior)[:, 0]


def _chained(
    curve: np.ndarray, down: np.ndarray, stiff: np.ndarray, gain: np.ndarray, prior: float
) -> np.ndarray:
    """Return the n numbers of each row, (T, n), that leave the least square.

    Args:
        curve: what each row says of its own: X'X, (T, n, n).
        down: X'y of it, (T, n).
        stiff: weight of each step between rows, (T - 1,).
        gain: the numbers' change in each step, (T - 1, n).
        prior: weight of 0.
    """
    count, size = down.shape
    blocks, right = curve + prior * np.eye(size), down.copy()
    for rows, sign in ((slice(1, None), 1.0), (slice(-1), -1.0)):
        blocks[rows] += stiff[:, None, None] * np.eye(size)
        right[rows] += sign * stiff[:, None] * gain
    banded = np.zeros((size + 1, count * size))  # the upper half of a block-tridiagonal matrix
    for row in range(size):
        for column in range(row, size):
            banded[size - (column - row), column::size] = blocks[:, row, column]
    banded[0, size:] = np.repeat(-stiff, size)
    return solveh_banded(banded, right.ravel()).reshape(count, size)
