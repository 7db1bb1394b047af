"""What is left once the causes are in: whether it has a structure, which, and what could catch it.

    describe(data, models_error, floor)     # "none", or a sentence

A free-form model (`free_form`) says how much could still be explained by anything that depends on
the commands and the motion, now or before.
"""

from __future__ import annotations

import numpy as np

from sim2real.diagnosis.attribution.free_form import caught, foreseen, slope
from sim2real.diagnosis.data.dataset import Data


def describe(data: Data, error: np.ndarray, floor: float) -> str:
    """Return what is left in a sentence; "none" where it is within `noise_floors` of the floor.

    Args:
        data: the windows.
        error: held-out errors with the causes, (W, T, M).
        floor: noise floor, in the units of errors.
    """
    count = max(data.mask.sum() * error.shape[2], 1)
    limits = data.settings.residual
    if np.sqrt((error**2).sum() / count) <= limits.noise_floors * floor:
        return "none"
    square = (error**2).sum(axis=(0, 1))
    worst = int(square.argmax())
    share = square[worst] / square.sum()
    joint = data.joints[worst].name
    place = f"most of it ({share:.0%}) at {joint}" if len(data.joints) > 1 else f"at {joint}"
    rest = caught(error, foreseen(data, error))
    free = (
        f"a free-form model of commands and motion would catch {rest:.0%} of its square"
        if rest > limits.found
        else "no free-form model of commands and motion catches any of it"
    )
    return f"{place}, {_tempo(data, error[..., worst])}, {_moment(data, error, worst)}; {free}"


def _tempo(data: Data, error: np.ndarray) -> str:
    """Return whether errors (W, T) are constant, slow or fast."""
    total = still = rough = 0.0
    for index, window in enumerate(data.windows):
        own = error[index, : len(window.usable)][window.usable]
        total += float((own**2).sum())
        still += float(len(own) * own.mean() ** 2)
        rough += float((np.diff(own) ** 2).sum())
    if still > data.settings.residual.constant * total:
        return "constant over seconds"
    return "fast" if rough > data.settings.residual.fast * total else "slow"


def _moment(data: Data, error: np.ndarray, joint: int) -> str:
    """Return when the errors of a joint are largest."""
    moving, resting, off = [], [], []
    limits = data.settings.residual
    for index, window in enumerate(data.windows):
        q = window.measured[:, joint]
        speed = np.abs(slope(q, window.sample[:, joint]))
        own = error[index, : len(q), joint] ** 2
        limit = limits.moving * max(data.joints[joint].spread, limits.spread_min)
        moving.append(own[window.usable & (speed > limit)])
        resting.append(own[window.usable & (speed <= limit)])
        if window.off > limits.off_share:
            off.append(own[window.usable])
    means = {
        "in motion": np.concatenate(moving),
        "at rest": np.concatenate(resting),
        "without torque": np.concatenate([np.zeros(0), *off]),
    }
    found = {name: float(v.mean()) for name, v in means.items() if v.size > limits.rows_min}
    return f"largest {max(found, key=lambda name: found[name])}" if found else "anywhere"
