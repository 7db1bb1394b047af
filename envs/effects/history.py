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
        none = np.empty((plant.num_rows, 0))
        self._history = plant.batch.bind("history") if model.nhistory else none  # (N, nhistory)
        self._first = model.actuator_historyadr[self._lines]  # (L,)
        self._samples, self._interp = model.actuator_history[self._lines].T
        self._found = np.zeros((plant.num_rows, model.nactuator))
        self._stale = True

    @classmethod
    def of(cls, plant: PlantView) -> Arrivals:
        """Return the plant's one; to be asked for while effects are bound."""
        return plant.share("arrivals", lambda: cls(plant))

    def prepare(self, ids: np.ndarray | slice) -> None:
        """Keep the rows whose commands are late, and the ranges of all."""
        limits = control_range(self._plant, slice(None))[:, self._columns]
        self._low, self._high = limits[..., 0], limits[..., 1]
        every = self._plant.batch.expanded("actuator_delay")
        delays = self._plant.model.actuator_delay if every is None else every
        shape = (self._plant.num_rows, len(self._lines))
        delays = np.broadcast_to(delays[..., self._lines], shape)
        self._rows = np.flatnonzero((delays > 0).any(axis=1))
        self._delay = delays[self._rows]
        self._at_newest = (self._rows[:, None], self._first + 1)
        self._after = np.ones(self._delay.shape, int)
        self._steps = bool((self._interp == 0).any())

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
        found = self._plant.ctrl[:, self._columns]
        if self._rows.size:
            at = (self._rows[:, None], self._lines)
            found[at] = self._late(found[at])
        self._found = np.clip(found, self._low, self._high)

    def _late(self, now: np.ndarray) -> np.ndarray:
        """Return the delay lines' values at the time minus the delay, as mj_readCtrl does.

        Args:
            now: what is sent to the actuators with a line in the rows with a delay, (n, L).
        """
        newest = self._history[self._at_newest].astype(int)  # (n, L)
        when = self._plant.time[self._at_newest[0]] - self._delay
        (t0, v0), (t1, v1) = self._around(newest, when + SAME)
        weight = np.clip((when - t0) / np.where(t1 > t0, t1 - t0, 1.0), 0.0, 1.0)
        if self._steps:
            weight = np.where(self._interp == 0, np.floor(weight + 1e-9), weight)
        return np.where(self._delay > 0, v0 + weight * (v1 - v0), now)

    def _around(self, newest: np.ndarray, when: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return times and values of the samples before and after a time, (n, L) each.

        The sample after it, counted from the oldest one, mostly is the same as in the substep
        before; where it is not, all of the line is looked at.
        """
        history, rows = self._history, self._at_newest[0]
        times, samples = self._first + 2, self._samples
        (t0, _), (t1, _) = pair = self._pair(newest)
        right = (t0 <= when) | (self._after == 1)
        right &= (t1 > when) | (self._after == samples - 1)
        if right.all():
            return pair
        for line in np.flatnonzero(~right.all(axis=0)):
            wrong, first, count = ~right[:, line], times[line], samples[line]
            own = history[rows[wrong], np.arange(first, first + count)]  # (n, samples)
            before = (own <= when[wrong, line, None]).sum(axis=1)
            self._after[wrong, line] = np.clip(before, 1, count - 1)
        return self._pair(newest)

    def _pair(self, newest: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        rows, times, samples = self._at_newest[0], self._first + 2, self._samples
        here = (newest + self._after) % samples
        places = (times + here, times + (here + 1) % samples)
        return [(self._history[rows, p], self._history[rows, p + samples]) for p in places]


def control_range(plant: PlantView, rows: np.ndarray | slice) -> np.ndarray:
    """Return the range to which the engine clamps each control, (n, nu, 2)."""
    model, expanded = plant.model, plant.batch.expanded("actuator_ctrlrange")
    limited = model.actuator_ctrllimited.astype(bool)[:, None]
    if expanded is None:
        own = np.where(limited, model.actuator_ctrlrange, UNBOUNDED)
        return np.broadcast_to(own, (len(plant.ctrl[rows]), *own.shape))
    return expanded[rows] if limited.all() else np.where(limited, expanded[rows], UNBOUNDED)
