"""Which logs are of one motion, and their windows: the same rows of each.

    motions = pair(logs, settings)                # [(0, 3), (1, 4), (2,)]
    data = aligned(Data.of(logs, model), motions)

Where two recordings were driven by the same commands, what the model cannot follow is in both of
them, and cancels in their difference.
"""

from collections.abc import Sequence

import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.windows import Window, cut_one
from sim2real.diagnosis.settings import Settings

Motions = list[tuple[int, ...]]


def pair(logs: Sequence[Log], settings: Settings) -> Motions:
    """Return groups of logs that were driven by the same commands, in their order."""
    found: list[list[int]] = []
    for number, log in enumerate(logs):
        for group in found:
            if same_rows(logs[group[0]], log, settings).mean() >= settings.compared.same_rows:
                group.append(number)
                break
        else:
            found.append([number])
    return [tuple(group) for group in found]


def same_rows(one: Log, other: Log, settings: Settings) -> np.ndarray:
    """Return whether each row of the first log was commanded alike in the other, (T,) bool."""
    rows = min(len(one), len(other))
    alike = np.zeros(len(one), bool)
    if one.actuators != other.actuators or not rows:
        return alike
    step = float(np.median(np.diff(one.time))) if len(one) > 1 else 0.0
    own = (one.episode[:rows] == one.episode[0]) == (other.episode[:rows] == other.episode[0])
    own &= np.abs(one.time[:rows] - other.time[:rows]) < step / 2
    for name in one.actuators:
        first, second = (log.columns[f"ctrl.{name}"][:rows] for log in (one, other))
        own &= np.abs(first - second) <= settings.preflight.same_command
        if f"torque.{name}" in one.columns and f"torque.{name}" in other.columns:
            first, second = (log.columns[f"torque.{name}"][:rows] for log in (one, other))
            own &= (first > 0) == (second > 0)
    alike[:rows] = own
    return alike


def aligned(data: Data, motions: Motions) -> tuple[Data, np.ndarray]:
    """Give the logs of one motion the windows of its first log.

    Returns:
        The data, and for each window the window of the first log with the same motion, (W,);
        its own number for those of a first log.
    """
    windows: list[Window] = []
    partner: list[int] = []
    for group in motions:
        first = group[0]
        own = [window for window in data.windows if window.log == first]
        start = len(windows)
        windows += own
        partner += range(start, start + len(own))
        for number in group[1:]:
            log = data.logs[number]
            same = same_rows(data.logs[first], log, data.settings)
            for place, window in enumerate(own):
                if (twin := _twin(data, window, number, same)) is not None:
                    windows.append(twin)
                    partner.append(start + place)
    return data.with_windows(windows), np.array(partner)


def _twin(data: Data, window: Window, number: int, same: np.ndarray) -> Window | None:
    """Return a window of the same rows of another log; None where too few rows are alike."""
    log = data.logs[number]
    if window.last > len(log) or len(set(log.episode[window.start : window.last])) > 1:
        return None
    which, rows = data.which[number], (window.start, window.first, window.last)
    model, settings = data.models[which], data.settings.windows
    made = cut_one(log, number, which, model, data.joints, rows, settings)
    usable = made.usable & window.usable & same[window.first : window.last]
    return made._replace(usable=usable) if usable.sum() > 1 else None
