"""Motions that an exam drives its robots along.

    ctrl = motion(low, high, home, rate=100, seconds=24, rng=rng)           # (T, n) rad

Parts of equal length follow each other: slow ramps, a chirp, steps, a multisine, poses that are
held. They fade in and out at the home pose.
"""

from collections.abc import Callable

import numpy as np

FADE = 0.5  # s
SIZE = 0.4  # part of the way to the nearer limit that is used
SLOW, FAST = 0.2, 2.5  # Hz
STEP, HOLD = 0.8, 1.6  # s between jumps
Wave = Callable[[np.ndarray, int, np.random.Generator], np.ndarray]


def motion(
    low: np.ndarray,
    high: np.ndarray,
    home: np.ndarray,
    rate: float,
    seconds: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Return the angles of a motion, (T, n) [rad].

    Args:
        low: least angles [rad], (n,).
        high: largest angles [rad], (n,).
        home: where it starts and ends [rad], (n,).
        rate: rows a second.
        seconds: of the whole motion.
        rng: of phases and poses.
    """
    reach = SIZE * np.minimum(high - home, home - low)
    rows = round(seconds * rate / len(WAVES))
    time = np.arange(rows) / rate
    fade = np.clip(np.minimum(time, time[-1] - time) / FADE, 0, 1)[:, None]
    return np.concatenate([home + reach * fade * wave(time, len(home), rng) for wave in WAVES])


def _ramp(time: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    turns = time[:, None] * rng.uniform(0.3, 0.45, n) + rng.uniform(0, 1, n)
    return 4 * np.abs(turns % 1 - 0.5) - 1


def _chirp(time: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    ratio, end = FAST / SLOW, time[-1]
    turns = SLOW * end / np.log(ratio) * (ratio ** (time / end) - 1)
    shrink = 1 / (1 + 1.5 * time / end)
    return shrink[:, None] * np.sin(2 * np.pi * (turns[:, None] + rng.uniform(0, 1, n)))


def _steps(time: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    return _held(time, n, STEP, rng)


def _poses(time: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    return _held(time, n, HOLD, rng)


def _held(time: np.ndarray, n: int, span: float, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-1, 1, (int(time[-1] / span) + 1, n))[(time / span).astype(int)]


def _sines(time: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    rates = np.geomspace(SLOW, FAST, 8)[:, None] * rng.uniform(0.9, 1.1, (8, n))
    phases = rng.uniform(0, 2 * np.pi, (8, n))
    waves = np.sin(2 * np.pi * rates * time[:, None, None] + phases).sum(axis=1)
    return waves / np.abs(waves).max(axis=0)


WAVES: tuple[Wave, ...] = (_ramp, _chirp, _steps, _sines, _poses)
