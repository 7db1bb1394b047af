"""What is left once the causes are in: whether it has a structure, which, and what could catch it.

    describe(data, models_error, floor)     # "none", or a sentence

A free-form model (ridge regression on smooth functions of the commands' and the joints' motion)
says how much could still be explained by anything that depends on them. It is fitted to one fold
and judged on the other: in sample such a model explains noise as well.
"""

from __future__ import annotations

import numpy as np

from sim2real.diagnosis.attribution.fit import FOLDS
from sim2real.diagnosis.data.dataset import Data, Window

CUBE = 3


def ceiling(data: Data, error: np.ndarray) -> float:
    """Return the share of the squared error (W, T, M) that a free-form model removes, held out."""
    left, whole, limits = 0.0, float((error**2).sum()), data.settings.residual
    if whole <= 0:
        return 0.0
    features = [_features(data, window) for window in data.windows]
    size = features[0].shape[1]
    curve, across = np.zeros((FOLDS, size, size)), np.zeros((FOLDS, size, error.shape[2]))
    for index, (window, table) in enumerate(zip(data.windows, features, strict=True)):
        own, f = window.usable, data.fold[index]
        rows = table[own]
        curve[f] += rows.T @ rows
        across[f] += rows.T @ error[index, : len(own)][own]
    models = [
        np.linalg.solve(c + limits.ridge * np.trace(c) / size * np.eye(size), a)
        for c, a in zip(curve, across, strict=True)
    ]
    for index, (window, table) in enumerate(zip(data.windows, features, strict=True)):
        own = window.usable
        model = models[1 - data.fold[index]]
        left += float(((error[index, : len(own)] - table @ model)[own] ** 2).sum())
    return 1.0 - left / whole


def _features(data: Data, window: Window) -> np.ndarray:
    """Return smooth functions of what the robot was told and did, (T, F), each about 1 in size."""
    time, limits = window.sample[:, 0], data.settings.residual
    columns = [np.ones(len(time))]
    for j, joint in enumerate(data.joints):
        q = window.measured[:, j] / max(joint.spread, limits.spread_min)
        speed = _slope(q, time) / limits.speed
        push = _slope(speed, time) / limits.acceleration
        sign, wave = np.tanh(limits.sign * speed), np.sin(limits.wave * q)
        columns += [q, q**2, q**CUBE, wave, speed, speed * np.abs(speed), sign, push]
        columns += [sign * np.abs(q), sign * np.abs(push)]
    return np.clip(np.column_stack(columns), -limits.feature_max, limits.feature_max)


def _slope(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    return np.gradient(values, time) if len(time) > 1 else np.zeros_like(values)


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
    caught = ceiling(data, error)
    free = (
        f"a free-form model of commands and motion would catch {caught:.0%} of its square"
        if caught > limits.found
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
        speed = np.abs(_slope(q, window.sample[:, joint]))
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
