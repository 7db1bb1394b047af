"""The engine's delay lines: what was sent to an actuator before, per row.

Layout of an actuator's part of MjData's `history`, with n samples: 0 (unused), index of the newest
sample, n times, n values; a ring. The engine fills it with zeros at a reset, which would jerk every
position servo towards 0.
"""

from __future__ import annotations

import numpy as np

from envs.effects.bound import BoundEffect, SubstepRule
from envs.effects.places import Block, block, spaced
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

    def on_episode_start(self, ids: np.ndarray, ctrl: np.ndarray) -> None:
        """Hold the commands (n, nu) for all of the past."""
        for column, address, samples in self._lines:
            first = address + 2 + samples
            self._history[ids[:, None], np.arange(first, first + samples)] = ctrl[:, column, None]


class DelayedCommands(SubstepRule):
    """The commands that reach the actuators in the coming substep, computed once per substep.

    Between two substeps nothing but a goal profile (order 10) changes it, and it is not read before
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
    def of(cls, plant: PlantView) -> DelayedCommands:
        """Return the plant's one; to be asked for while effects are bound."""
        return plant.shared_mechanism("arrivals", lambda: cls(plant))

    def prepare(self, ids: np.ndarray | slice) -> None:
        """Keep the rows whose commands are late, and the ranges of all."""
        limits = control_range(self._plant, slice(None))[:, self._columns]
        self._low, self._high = limits[..., 0], limits[..., 1]
        every = self._plant.batch.expanded("actuator_delay")
        delays = self._plant.model.actuator_delay if every is None else every
        shape = (self._plant.num_rows, len(self._lines))
        delays = np.broadcast_to(delays[..., self._lines], shape)
        late = np.flatnonzero((delays > 0).any(axis=1))
        self._some, self._rows, self._delay = bool(late.size), late[:, None], delays[late]
        self._when, self._at = spaced(late), block(late, self._lines)
        self._newest = block(late, self._first + 1)
        self._in_time = None if (self._delay > 0).all() else self._delay <= 0
        self._stepped = self._interp == 0 if (self._interp == 0).any() else None
        self._look(np.ones(self._delay.shape, int))

    def before_substep(self, ids: np.ndarray | slice) -> None:
        """Forget what reached the actuators before."""
        self._stale = True

    def at(self, places: Block) -> np.ndarray:
        """Return the commands that reach a block of rows and actuators, clamped, (n, k)."""
        if self._stale:
            self._read()
            self._stale = False
        return self._found[places]

    def _read(self) -> None:
        found = self._plant.ctrl[:, self._columns]
        if self._some:
            found[self._at] = self._late(found[self._at])
        self._found = np.minimum(np.maximum(found, self._low), self._high)

    def _late(self, now: np.ndarray) -> np.ndarray:
        """Return the delay lines' values at the time minus the delay, as mj_readCtrl does.

        Args:
            now: what is sent to the actuators with a line in the rows with a delay, (n, L).
        """
        newest = self._history[self._newest].astype(int)  # (n, L)
        when = self._plant.time[self._when][:, None] - self._delay
        t0, t1, v0, v1 = self._around(newest, when + SAME)
        weight = (when - t0) / np.where(t1 > t0, t1 - t0, 1.0)
        weight = np.minimum(np.maximum(weight, 0.0), 1.0)
        if self._stepped is not None:
            weight = np.where(self._stepped, np.floor(weight + 1e-9), weight)
        late = v0 + weight * (v1 - v0)
        return late if self._in_time is None else np.where(self._in_time, now, late)

    def _around(self, newest: np.ndarray, when: np.ndarray) -> np.ndarray:
        """Return times and values of the samples before and after a time, (4, n, L).

        The sample after it, counted from the oldest one, mostly is the same as in the substep
        before; where it is not, all of the line is looked at.
        """
        found = self._pair(newest)
        right = (found[0] <= when) | self._first_one
        right &= (found[1] > when) | self._last_one
        if right.all():
            return found
        after, times, samples = self._after, self._first + 2, self._samples
        for line in np.flatnonzero(~right.all(axis=0)):
            wrong, first, count = ~right[:, line], times[line], samples[line]
            own = self._history[self._rows[wrong], np.arange(first, first + count)]  # (n, samples)
            before = (own <= when[wrong, line, None]).sum(axis=1)
            after[wrong, line] = np.clip(before, 1, count - 1)
        self._look(after)
        return self._pair(newest)

    def _look(self, after: np.ndarray) -> None:
        """Keep which sample comes after the time in question, counted from the oldest, (n, L)."""
        self._after, self._pairs = after, np.stack([after, after + 1])
        self._first_one, self._last_one = after == 1, after == self._samples - 1

    def _pair(self, newest: np.ndarray) -> np.ndarray:
        times = self._first + 2 + (newest + self._pairs) % self._samples  # (2, n, L)
        return self._history[self._rows, np.concatenate([times, times + self._samples])]


def control_range(plant: PlantView, rows: np.ndarray | slice) -> np.ndarray:
    """Return the range to which the engine clamps each control, (n, nu, 2)."""
    model, expanded = plant.model, plant.batch.expanded("actuator_ctrlrange")
    limited = model.actuator_ctrllimited.astype(bool)[:, None]
    if expanded is None:
        own = np.where(limited, model.actuator_ctrlrange, UNBOUNDED)
        return np.broadcast_to(own, (len(plant.ctrl[rows]), *own.shape))
    return expanded[rows] if limited.all() else np.where(limited, expanded[rows], UNBOUNDED)
