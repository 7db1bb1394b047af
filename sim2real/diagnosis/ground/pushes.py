"""Windows in which something from outside moved the robot: a push, a hit, a hand.

    kept = ~is_pushed(data, error)
    findings = check_pushes(data, estimates)        # data without them

A missing effect is wrong whenever the robot moves as it does; a push is wrong once. So windows are
left out in which the base turns by many times more than the model lets expect, compared with all
the others, as long as these are few. The report tells when they were.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.pairs import name_of
from sim2real.diagnosis.data.recording import episode_rows
from sim2real.diagnosis.ground.estimate import Estimate
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import Ground

SHOWN = 3  # moments that a sentence names


def is_pushed(data: Data, error: np.ndarray) -> np.ndarray:
    """Return which windows are pushed, (W,) bool, from errors of the model as given (W, T, M).

    None are, where these would be many, or all of a log: the model is wrong there.
    """
    settings = data.settings.ground
    turn = ["." in joint.name and joint.scale < 1 for joint in data.joints]
    size = np.sqrt(data.window_squares(error[..., turn]))  # rad, of the base's turn
    far = size > max(settings.push_times * float(np.median(size)), settings.told_rad)
    logs = np.array([window.log for window in data.windows])
    whole = any(far[logs == log].all() for log in set(logs.tolist()))
    return far & (not whole and far.mean() <= settings.told_share)


def rows_of(estimate: Estimate, settings: Ground) -> list[tuple[int, int, int]]:
    """Return start, first compared row and end of each window."""
    found = []
    for rows in episode_rows(estimate.log):
        step, count = float(np.median(np.diff(estimate.log.time[rows]))), rows.stop - rows.start
        length = max(round(settings.window_s / step), 2)
        cuts = np.linspace(1, count - 1, max((count - 2) // length, 1) + 1).astype(int)
        ends = pairwise((rows.start + cuts).tolist())
        found += [(a, a + 1, b + 1) for a, b in ends if b > a]
    return found


def check_pushes(data: Data, estimates: Sequence[Estimate]) -> Iterator[Finding]:
    """Yield a finding for each log with windows that were left out of the data."""
    for number, estimate in enumerate(estimates):
        kept, log = {w.start for w in data.windows if w.log == number}, estimate.log
        every = rows_of(estimate, data.settings.ground)
        rows = [start for start, _, _ in every if start not in kept]
        times = ", ".join(f"{log.time[row]:.2f}" for row in rows[:SHOWN]) + " s"
        more = f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else ""
        if rows:
            yield Finding(
                "push",
                None,
                f"{name_of(log, f'log {number + 1}')}: something moved the base that no other "
                f"moment shows, in the windows that begin at {times}{more} (a push, a hit, a hand, "
                "a jump of the IMU). They are left out.",
                "Look at what happened there; record again if it is more than a moment.",
            )
