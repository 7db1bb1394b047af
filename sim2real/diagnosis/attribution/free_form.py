"""What a model without any physics could still explain of the errors, from all that a log says.

    guess = foreseen(data, error)               # (W, T, M): errors, told from the other fold
    share = caught(error, guess)                # of the squared error

Ridge regression on what the robot was told and did, and had been told and done: positions, speeds,
commands and their lags, play operators and leaky integrals, and the double integrals of all these
from a window's start. What an effect with a memory leaves (a
delay, play, hysteresis, heat) shows there too. It is fitted to one fold and judged on the other: in
sample such a model explains noise as well.
"""

from __future__ import annotations

import numpy as np

from hardware.log import Log
from sim2real.diagnosis.attribution.problem import FOLDS
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.settings import TINY, Residual

CUBE = 3


def foreseen(data: Data, error: np.ndarray) -> np.ndarray:
    """Return what a free-form model of the other fold says of errors (W, T, M), (W, T, M).

    Of two, the one that catches more: with the double integrals, or, of joints that servos hold,
    without them.
    """
    plain = _features(data)
    times = [data.logs[w.log].time[w.first :][: len(w.usable)] for w in data.windows]
    pushed = [np.hstack([f, _pushed(f, t)]) for f, t in zip(plain, times, strict=True)]
    guesses = [_predicted(data, error, features) for features in (plain, pushed)]
    return max(guesses, key=lambda guess: caught(error, guess))


def _predicted(data: Data, error: np.ndarray, features: list[np.ndarray]) -> np.ndarray:
    """Return what ridge regression on the other fold's features says of errors, (W, T, M)."""
    limits = data.settings.residual
    size = features[0].shape[1]
    curve, across = np.zeros((FOLDS, size, size)), np.zeros((FOLDS, size, error.shape[2]))
    for wrong, table, mask, fold in zip(error, features, data.mask, data.fold, strict=True):
        own = mask[: len(table)]
        curve[fold] += table[own].T @ table[own]
        across[fold] += table[own].T @ wrong[: len(table)][own]
    models = [
        np.linalg.solve(c + limits.ridge * np.trace(c) / size * np.eye(size), a)
        for c, a in zip(curve, across, strict=True)
    ]
    guess = np.zeros_like(error)
    for row, table, mask, fold in zip(guess, features, data.mask, data.fold, strict=True):
        row[: len(table)] = np.where(mask[: len(table), None], table @ models[1 - fold], 0.0)
    return guess


def caught(error: np.ndarray, guess: np.ndarray) -> float:
    """Return the share of squared errors (W, T, M) that a guess of them removes; 0 at least."""
    whole = float((error**2).sum())
    return max(1.0 - float(((error - guess) ** 2).sum()) / whole, 0.0) if whole > 0 else 0.0


def _features(data: Data) -> list[np.ndarray]:
    """Return the features of each window's rows, (T, F) each, each feature about 1 in size."""
    limits, tables = data.settings.residual, {}
    spreads = [max(joint.spread, limits.spread_min) for joint in data.joints]
    for number, log in enumerate(data.logs):
        for episode in {w.episode for w in data.windows if w.log == number}:
            rows = np.flatnonzero(log.episode == episode)
            tables[number, episode] = rows[0], _history(data, log, rows, spreads)
    found = []
    for window in data.windows:
        start, table = tables[window.log, window.episode]
        found.append(table[window.first - start :][: len(window.usable)])
    return found


def _pushed(forces: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return where forces (T, F) have pushed something free since the first row, (T, F).

    A window starts from what was measured: a torque that the model lacks shows as its double
    integral from there on, where no servo pulls the joint back.
    """
    steps = np.diff(time, prepend=time[0])[:, None]
    way = np.cumsum(steps * np.cumsum(steps * forces, axis=0), axis=0)
    return way / max(float(np.ptp(time)) ** 2 / 2, TINY)


def _history(data: Data, log: Log, rows: np.ndarray, spreads: list[float]) -> np.ndarray:
    """Return the features of one episode's rows, (T, F)."""
    limits, time = data.settings.residual, log.time[rows]
    columns = [np.ones(len(rows))]
    for joint, spread in zip(data.joints, spreads, strict=True):
        q = log.column(f"qpos.{joint.name}")[rows] / spread
        columns += _moving(q, time, limits)
        columns += _remembered(q, time, limits)
    for actuator in log.actuators:
        told = log.column(f"ctrl.{actuator}")[rows]
        u = (told - told.mean()) / max(float(told.std()), TINY)
        columns += [u, *_remembered(u, time, limits)]
    return np.clip(np.column_stack(columns), -limits.feature_max, limits.feature_max)


def _moving(q: np.ndarray, time: np.ndarray, limits: Residual) -> list[np.ndarray]:
    """Return smooth functions of a motion (T,) as it is now."""
    speed = slope(q, time) / limits.speed
    push = slope(speed, time) / limits.acceleration
    sign, wave = np.tanh(limits.sign * speed), np.sin(limits.wave * q)
    shapes = [q, q**2, q**CUBE, wave, speed, speed * np.abs(speed), sign, push]
    return [*shapes, sign * np.abs(q), sign * np.abs(push)]


def _remembered(signal: np.ndarray, time: np.ndarray, limits: Residual) -> list[np.ndarray]:
    """Return what came before of a signal (T,): lags, play operators, leaky integrals."""
    lags = [np.interp(time - lag, time, signal) - signal for lag in limits.lags_s]
    plays = [(signal - _play(signal, width / 2)) / width for width in limits.plays]
    speed = slope(signal, time)
    heats = [_leaky(speed**2, time, decay) for decay in limits.decays_s]
    return [*lags, *plays, *(heat / max(float(heat.std()), TINY) for heat in heats)]


def slope(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return how fast values (T,) change at times (T,)."""
    return np.gradient(values, time) if len(time) > 1 else np.zeros_like(values)


def _play(signal: np.ndarray, half: float) -> np.ndarray:
    """Return the play operator: what follows a signal (T,) once it is `half` away."""
    out = np.empty_like(signal)
    at = signal[0]
    for k, value in enumerate(signal.tolist()):
        at = min(max(at, value - half), value + half)
        out[k] = at
    return out


def _leaky(values: np.ndarray, time: np.ndarray, decay: float) -> np.ndarray:
    """Return the mean of values (T,) that forgets with a time constant [s]."""
    out = np.empty_like(values)
    at, keep = float(values.mean()), np.exp(-np.diff(time, prepend=time[0]) / decay)
    for k, (value, kept) in enumerate(zip(values.tolist(), keep.tolist(), strict=True)):
        at = kept * at + (1 - kept) * value
        out[k] = at
    return out
