"""Logs of a joint whose speed is late or filtered, and whose stamps drift."""

import numpy as np
from scipy.signal import lfilter

from hardware.log import Log

RATE, SECONDS = 100.0, 60.0  # Hz, s
COUNT = 2 * np.pi / 4096  # rad, of an encoder
SPEED = 0.024  # rad/s, of a Dynamixel's speed register


def motion(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return position and speed of a rich motion."""
    tones = [(0.3, 0.6, 0.0), (0.9, 0.3, 1.0), (2.1, 0.1, 2.0)]  # Hz, rad, rad
    angle = sum(a * np.sin(2 * np.pi * f * time + p) for f, a, p in tones)
    speed = sum(2 * np.pi * f * a * np.cos(2 * np.pi * f * time + p) for f, a, p in tones)
    return np.asarray(angle), np.asarray(speed)


def log(late: float = 0.0, ppm: float = 0.0, filtered: float = 0.0, seed: int = 0) -> Log:
    """Return a log whose speed is late [s] or filtered [s], and whose stamps drift [ppm]."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, SECONDS, 1 / RATE)
    time += rng.normal(0, 3e-4, len(time)).clip(-1e-3, 1e-3)
    time -= time[0]
    read = time - 2e-3 + rng.normal(0, 3e-4, len(time))
    angle, _ = motion(read)
    _, speed = motion(read - late)
    if filtered:
        share = 1 - np.exp(-1 / RATE / filtered)
        speed = np.asarray(lfilter([share], [1, share - 1], speed))
    columns = {
        "episode": np.zeros(len(time)),
        "time": time,
        "ctrl.hinge": angle,
        "qpos.hinge": COUNT * np.round(angle / COUNT),
        "qvel.hinge": SPEED * np.round(speed / SPEED),
        "stamp.hinge": read * (1 + 1e-6 * ppm),
    }
    return Log(columns)


def silent() -> tuple[Log, Log, Log]:
    """Return logs that say nothing: a joint at rest, a handful of rows, no speed and no stamps."""
    rest = log()
    still = {c: 0 * v if c.startswith("q") else v for c, v in rest.columns.items()}
    short = {c: v[:10] for c, v in rest.columns.items()}
    bare = {c: v for c, v in rest.columns.items() if not c.startswith(("qvel", "stamp"))}
    return Log(still), Log(short), Log(bare)
