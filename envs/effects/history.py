"""The engine's delay lines: what was sent to an actuator before, per row.

Layout of an actuator's part of MjData's `history`, with n samples: 0 (unused), index of the newest
sample, n times, n values; a ring. The engine fills it with zeros at a reset, which would jerk every
position servo towards 0.
"""

from __future__ import annotations

import numpy as np

from envs.effects.base import BoundEffect, SubstepRule
from envs.effects.plant_view import PlantView

UNBOUNDED = (-np.inf, np.inf)
SAME = 1e-10  # s: times this close are equal, as the engine takes them


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


class Arrivals(SubstepRule):
    """What reaches the actuators in the coming substep; read once for all who ask.

    Between two substeps nothing but a goal profile (order 10) changes it, and nobody asks before
    that has acted.
    """

    order = 0

    def __init__(self, plant: PlantView) -> None:
        self._plant, model = plant, plant.model
        self._columns = model.actuator_ctrladr[: model.nactuator]
        self._lines = np.flatnonzero(
            (model.actuator_historyadr >= 0) & (model.actuator_ctrlnum == 1)
        )
        self._history = plant.batch.bind("history") if model.nhistory else None  # (N, nhistory)
        self._found = np.zeros((plant.num_rows, model.nactuator))
        self._stale = True

    @classmethod
    def of(cls, plant: PlantView) -> Arrivals:
        """Return the plant's one; to be asked for while effects are bound."""
        return plant.share("arrivals", lambda: cls(plant))

    def before_substep(self, ids: np.ndarray | slice) -> None:
        """Forget what reached the actuators before."""
        self._stale = True

    def at(self, rows: np.ndarray | slice, actuators: np.ndarray) -> np.ndarray:
        """Return the command that reaches actuators (k,), clamped, (n, k)."""
        if self._stale:
            self._read()
            self._stale = False
        return self._found[rows][:, actuators]

    def _read(self) -> None:
        plant = self._plant
        found = plant.ctrl[:, self._columns]
        for i in self._lines.tolist():
            found[:, i] = self._late(i, found[:, i])
        limits = control_range(plant, slice(None))[:, self._columns]
        self._found = np.clip(found, limits[..., 0], limits[..., 1])

    def _late(self, actuator: int, now: np.ndarray) -> np.ndarray:
        """Return the delay line's value at the time minus the delay, as mj_readCtrl does, (N,)."""
        plant, model = self._plant, self._plant.model
        samples, interp = model.actuator_history[actuator]
        delays = plant.batch.expanded("actuator_delay")
        delay = model.actuator_delay[actuator] if delays is None else delays[:, actuator]
        delay = np.broadcast_to(delay, now.shape)
        rows = np.flatnonzero(delay > 0)
        if self._history is None or not rows.size:
            return now
        first = int(model.actuator_historyadr[actuator])
        line = self._history[rows, first : first + 2 + 2 * samples]  # (n, 2 + 2 samples)
        times, values = line[:, 2 : 2 + samples], line[:, 2 + samples :]
        oldest = line[:, 1].astype(int) + 1
        when = plant.time[rows] - delay[rows]
        each = np.arange(len(rows))
        after = np.clip((times <= (when + SAME)[:, None]).sum(axis=1), 1, samples - 1)
        here, there = (oldest + after - 1) % samples, (oldest + after) % samples
        t0, t1 = times[each, here], times[each, there]
        v0, v1 = values[each, here], values[each, there]
        weight = np.clip((when - t0) / np.where(t1 > t0, t1 - t0, 1.0), 0.0, 1.0)
        if interp == 0:
            weight = np.floor(weight + 1e-9)
        late = now.copy()
        late[rows] = v0 + weight * (v1 - v0)
        return late


def control_range(plant: PlantView, rows: np.ndarray | slice) -> np.ndarray:
    """Return the range to which the engine clamps each control, (n, nu, 2)."""
    model, expanded = plant.model, plant.batch.expanded("actuator_ctrlrange")
    limited = model.actuator_ctrllimited.astype(bool)[:, None]
    if expanded is None:
        own = np.where(limited, model.actuator_ctrlrange, UNBOUNDED)
        return np.broadcast_to(own, (len(plant.ctrl[rows]), *own.shape))
    return expanded[rows] if limited.all() else np.where(limited, expanded[rows], UNBOUNDED)
