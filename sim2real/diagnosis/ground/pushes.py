"""Windows in which something from outside moved the robot: a push, a hit, a hand.

    kept = ~is_pushed(data, error)
    weight = weights(data, error)                   # of the others, up to 1
    findings = check_pushes(data, estimates)        # data without them

A missing effect is wrong whenever the robot moves as it does; a push is wrong once. So windows are
left out in which the base turns by many times more than the model lets expect, compared with all
the others, as long as these are few. Those in which it turns by a few times more count for less: as
far as a window is odd, its error no longer grows (Huber 1964). The report tells when they were.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.ground.estimate import Estimate
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import TINY, Ground

SHOWN = 3  # moments that a sentence names


def is_pushed(data: Data, error: np.ndarray) -> np.ndarray:
    """Return which windows are pushed, (W,) bool, from errors of the model as given (W, T, M)."""
    settings, size = data.settings.ground, _turned(data, error)
    far = size > max(settings.push_times * float(np.median(size)), settings.push_rad)
    return far if _is_odd(data, far) else np.zeros(len(error), bool)


def weights(data: Data, error: np.ndarray) -> np.ndarray:
    """Return how much each window counts, (W,), from errors of the model as given (W, T, M)."""
    settings, size = data.settings.ground, _turned(data, error)
    usual = max(settings.odd_times * float(np.median(size)), settings.odd_rad)
    found = np.minimum(usual / np.maximum(size, TINY), 1.0)
    return found if _is_odd(data, found < 1.0) else np.ones(len(error))


def _turned(data: Data, error: np.ndarray) -> np.ndarray:
    """Return the error of the base's turn in each window, root mean square [rad], (W,)."""
    turn = np.array(["." in joint.name and joint.scale < 1 for joint in data.joints])
    rows = np.maximum(data.mask.sum(axis=1), 1)
    return np.sqrt((error[..., turn] ** 2).sum(axis=(1, 2)) / rows)


def _is_odd(data: Data, far: np.ndarray) -> bool:
    """Return whether windows (W,) are few, and not all of a log: else the model is wrong there."""
    logs = np.array([window.log for window in data.windows])
    whole = any(far[logs == log].all() for log in set(logs.tolist()))
    return bool(far.mean() <= data.settings.ground.push_share) and not whole


def rows_of(estimate: Estimate, settings: Ground) -> list[tuple[int, int, int]]:
    """Return start, first compared row and end of each window."""
    found, start = [], 0
    for part in estimate.log.episodes():
        step = float(np.median(np.diff(part.time)))
        length = max(round(settings.window_s / step), 2)
        pieces = max((len(part) - 2) // length, 1)
        cuts = np.linspace(1, len(part) - 1, pieces + 1).astype(int)
        found += [
            (start + a, start + a + 1, start + b + 1) for a, b in pairwise(cuts.tolist()) if b > a
        ]
        start += len(part)
    return found


def check_pushes(data: Data, estimates: Sequence[Estimate], settings: Ground) -> list[Finding]:
    """Return a finding for each log with windows that were left out.

    Args:
        data: the windows that are left.
        estimates: of each log.
        settings: how long windows are.
    """
    found = []
    for number, estimate in enumerate(estimates):
        kept = {w.start: k for k, w in enumerate(data.windows) if w.log == number}
        rows = [start for start, _, _ in rows_of(estimate, settings) if start not in kept]
        log = estimate.log
        name = log.path.name if log.path else f"log {number + 1}"
        weight = np.ones(len(data.windows)) if data.nuisance is None else data.nuisance.weight
        odd = [start for start, k in kept.items() if weight[k] < 1.0]
        if odd:
            found.append(
                Finding(
                    "odd",
                    None,
                    f"{name}: the base moves otherwise than at most moments in the windows that "
                    f"begin at {_moments(log, odd)} (a light push, a hard landing, a slip). They "
                    "count for less.",
                    "No action needed.",
                )
            )
        if rows:
            found.append(
                Finding(
                    "push",
                    None,
                    f"{name}: something moved the base that no other moment shows, in the windows "
                    f"that begin at {_moments(log, rows)} (a push, a hit, a hand, a jump of the "
                    "IMU). They are left out.",
                    "Look at what happened there; record again if it is more than a moment.",
                )
            )
    return found


def _moments(log: Log, rows: Sequence[int]) -> str:
    """Return the times of some rows in words."""
    times = ", ".join(f"{log.time[row]:.2f}" for row in rows[:SHOWN])
    return f"{times} s" + (f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else "")
