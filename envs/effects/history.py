"""The engine's delay lines: what was sent to an actuator before, per row.

Layout of an actuator's part of MjData's `history`, with n samples: 0 (unused), index of the newest
sample, n times, n values; a ring. The engine fills it with zeros at a reset, which would jerk every
position servo towards 0.
"""

from __future__ import annotations

import numpy as np

from envs.effects.base import BoundEffect
from envs.effects.plant_view import PlantView


class CommandHistory(BoundEffect):
    """Fills the delay lines with the command that was held from before the episode."""

    def __init__(self, plant: PlantView) -> None:
        self._plant, model = plant, plant.model
        self._history = plant.batch.bind("history")  # (N, nhistory)
        single = [
            i
            for i in range(model.nactuator)
            if model.actuator_historyadr[i] >= 0 and model.actuator_ctrlnum[i] == 1
        ]
        self._lines = [
            (
                int(model.actuator_ctrladr[i]),
                int(model.actuator_historyadr[i]),
                int(model.actuator_history[i, 0]),
            )
            for i in single
        ]

    def start(self, ids: np.ndarray, ctrl: np.ndarray) -> None:
        """Hold the commands (n, nu) for all of the past."""
        for column, address, samples in self._lines:
            first = address + 2 + samples
            self._history[ids[:, None], np.arange(first, first + samples)] = ctrl[:, column, None]


def arriving(plant: PlantView, actuator: int, rows: np.ndarray | slice) -> np.ndarray:
    """Return the command that reaches an actuator in the coming substep, clamped, (n,)."""
    model = plant.model
    column, address = (
        int(model.actuator_ctrladr[actuator]),
        int(model.actuator_historyadr[actuator]),
    )
    ctrl = plant.ctrl[rows, column]
    if address >= 0:
        ctrl = _read(plant, actuator, rows, address, ctrl)
    low, high = control_range(plant, rows)[:, column].T
    return np.clip(ctrl, low, high)


def control_range(plant: PlantView, rows: np.ndarray | slice) -> np.ndarray:
    """Return the range to which the engine clamps each control, (n, nu, 2)."""
    model, expanded = plant.model, plant.batch.expanded("actuator_ctrlrange")
    n = len(plant.ctrl[rows])
    ranges = np.tile(model.actuator_ctrlrange, (n, 1, 1)) if expanded is None else expanded[rows]
    limited = model.actuator_ctrllimited.astype(bool)[:, None]
    return np.where(limited, ranges, [-np.inf, np.inf])


def _read(
    plant: PlantView, actuator: int, rows: np.ndarray | slice, address: int, ctrl: np.ndarray
) -> np.ndarray:
    """Return the delay line's value at the time minus the delay, as mj_readCtrl does, (n,)."""
    samples, interp = plant.model.actuator_history[actuator]
    delays = plant.batch.expanded("actuator_delay")
    delay = plant.model.actuator_delay[actuator] if delays is None else delays[rows, actuator]
    history = plant.batch.bind("history")[
        rows, address : address + 2 + 2 * samples
    ]  # (n, 2 + 2 samples)
    slots = (history[:, 1:2].astype(int) + 1 + np.arange(samples)) % samples  # oldest first
    times = np.take_along_axis(history[:, 2 : 2 + samples], slots, 1)
    values = np.take_along_axis(history[:, 2 + samples :], slots, 1)
    when = (plant.time[rows] - delay)[:, None]
    after = np.clip((times <= when + 1e-10).sum(1), 1, samples - 1)[
        :, None
    ]  # first sample later than `when`
    t0, t1 = np.take_along_axis(times, after - 1, 1), np.take_along_axis(times, after, 1)
    v0, v1 = np.take_along_axis(values, after - 1, 1), np.take_along_axis(values, after, 1)
    weight = np.clip((when - t0) / np.where(t1 > t0, t1 - t0, 1.0), 0.0, 1.0)
    if interp == 0:
        weight = np.floor(weight + 1e-9)
    read = (v0 + weight * (v1 - v0))[:, 0]
    return np.where(delay > 0, read, ctrl)
