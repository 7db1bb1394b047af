"""What a robot measured while a policy ran, as samples: encoders and IMU over a few rows.

    episodes = episodes_of(logs)
    names = shared([*episodes, *simulated])             # columns that all of them have
    samples, group = histories(episodes, names, settings)

A sample is a few consecutive rows of all channels side by side. Nothing aligns one world's time
with another's: a closed loop goes its own way from the first difference on. An orientation counts
as the direction of gravity in the sensor's frame, since a heading is arbitrary.
"""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from hardware.log import Log
from sim2real.diagnosis.contract.rebuild import gravity
from sim2real.diagnosis.contract.rows import is_sent
from sim2real.diagnosis.contract.terms import AXES
from sim2real.diagnosis.settings import ClosedLoopSettings

QUATERNION = ("w", *AXES)


class Episode(NamedTuple):
    """One episode of a policy, on the robot or in a simulator."""

    columns: Mapping[str, np.ndarray]  # encoders and IMU, named as in a log, (T,) each
    step: float  # seconds from row to row, in the median
    returned: float | None  # what the task paid; None where it is not known


def episodes_of(logs: Sequence[Log]) -> list[Episode]:
    """Return the episodes of logs of at least two rows; returns are sums of `reward`."""
    found = []
    for part in chain.from_iterable(log.episodes() for log in logs):
        own = {name: values[is_sent(part)] for name, values in part.columns.items()}
        reward = part.columns.get("reward")
        paid = None if reward is None else float(reward.sum())
        found.append(Episode(as_measured(own), float(np.median(np.diff(part.time))), paid))
    return found


def as_measured(columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return positions and an IMU's channels, orientations as directions of gravity."""
    found = {n: v for n, v in columns.items() if n.startswith(("qpos.", "gyro."))}
    for name in columns:
        kind, _, rest = name.partition(".")
        site = rest.removesuffix(".w")
        if kind == "quat" and site != rest:
            turn = np.column_stack([columns[f"quat.{site}.{part}"] for part in QUATERNION])
            down = zip(AXES, gravity(turn).T, strict=True)
            found |= {f"gravity.{site}.{axis}": values for axis, values in down}
    return found


def shared(episodes: Sequence[Episode]) -> list[str]:
    """Return the channels that all episodes have, in the order of the first."""
    return [n for n in episodes[0].columns if all(n in one.columns for one in episodes)]


def histories(
    episodes: Sequence[Episode], names: Sequence[str], settings: ClosedLoopSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Return samples (N, rows x channels), and the episode of each, (N,).

    Args:
        episodes: E of them; one that is shorter than a history has no sample.
        names: the channels.
        settings: how long a history is, and how many an episode gives.
    """
    samples, group = [np.zeros((0, settings.rows * len(names)))], [np.zeros(0, int)]
    for number, one in enumerate(episodes):
        values = np.column_stack([one.columns[name] for name in names])  # (T, C)
        if len(values) < settings.rows:
            continue
        every = sliding_window_view(values, settings.rows, axis=0)  # (T - rows + 1, C, rows)
        count = min(settings.samples, len(every))
        chosen = np.linspace(0, len(every) - 1, count).round().astype(int)
        samples.append(every[chosen].reshape(count, -1))
        group.append(np.full(count, number))
    return np.concatenate(samples), np.concatenate(group)
