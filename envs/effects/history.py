"""The engine's delay lines: what was sent to an actuator before, per row.

Layout of an actuator's part of MjData's `history`, with n samples: 0 (unused), index of the newest
sample, n times, n values; a ring. The engine fills it with zeros at a reset, which would jerk every
position servo towards 0.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from envs.effects.bound import BoundEffect, SubstepRule
from envs.effects.places import block, spaced
from envs.effects.plant_view import PlantView
from envs.physics.arrays import Array, Arrays

UNBOUNDED = (-np.inf, np.inf)
SAME = 1e-10, 1e-6  # s: times this close are equal to the engines, in float64 and in float32


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
        self.fill(ids, ctrl[:, None])

    def fill(self, ids: np.ndarray, past: np.ndarray) -> None:
        """Hold past commands, (n, P, nu): one for each sample of the longest line, or P = 1."""
        for column, address, samples in self._lines:
            first = address + 2 + samples
            own = past[:, -samples:, column]
            self._history[ids[:, None], np.arange(first, first + samples)] = own


class DelayedCommands(SubstepRule):
    """The commands that reach the actuators in the coming substep, computed once per substep.

    Between two substeps nothing but a goal profile (order 10) changes it, and it is not read before
    that has acted.
    """

    order = 0

    def __init__(self, plant: PlantView) -> None:
        self._plant, model = plant, plant.model
        self._arrays: Arrays = plant.arrays
        self._same = SAME[0] if self._arrays.on_host else SAME[1]
        self._columns = model.actuator_ctrladr[: model.nactuator]
        self._lines = np.flatnonzero(
            (model.actuator_historyadr >= 0) & (model.actuator_ctrlnum == 1)
        )
        none = self._arrays.zeros((plant.num_rows, 0))
        self._history = plant.physics.bind("history") if model.nhistory else none  # (N, nhistory)
        self._first = model.actuator_historyadr[self._lines]  # (L,)
        self._samples, self._interp = model.actuator_history[self._lines].T
        self._times, self._length, self._sent = (
            self._arrays.own(one) for one in (self._first + 2, self._samples, self._columns)
        )
        self._found = self._arrays.zeros((plant.num_rows, model.nactuator))
        self._stale = True

    @classmethod
    def of(cls, plant: PlantView) -> DelayedCommands:
        """Return the plant's one; to be asked for while effects are bound."""
        return plant.shared_mechanism("arrivals", lambda: cls(plant))

    def prepare(self, ids: np.ndarray | slice) -> None:
        """Keep the rows whose commands are late, and the ranges of all."""
        own, index = self._arrays.own, self._arrays.index
        limits = own(control_range(self._plant, slice(None))[:, self._columns])
        self._low, self._high = limits[..., 0], limits[..., 1]
        every = self._plant.batch.expanded("actuator_delay")
        delays = self._plant.model.actuator_delay if every is None else every
        shape = (self._plant.num_rows, len(self._lines))
        delays = np.broadcast_to(delays[..., self._lines], shape)
        late = np.flatnonzero((delays > 0).any(axis=1))
        self._some, self._rows, self._delay = bool(late.size), own(late), own(delays[late])
        self._when, self._at = index(spaced(late)), index(block(late, self._lines))
        self._newest = index(block(late, self._first + 1))
        self._in_time = None if (self._delay > 0).all() else self._delay <= 0
        self._stepped = own(self._interp == 0) if (self._interp == 0).any() else None
        self._look(own(np.ones(self._delay.shape, int)))

    def before_substep(self, ids: np.ndarray | slice) -> None:
        """Forget what reached the actuators before."""
        self._stale = True

    def at(self, places: Any) -> Array:
        """Return the commands that reach a block of rows and actuators, clamped, (n, k)."""
        if self._stale:
            self._read()
            self._stale = False
        return self._found[places]

    def _read(self) -> None:
        xp, found = self._arrays.xp, self._plant.ctrl[:, self._sent]
        if self._some:
            found[self._at] = self._late(found[self._at])
        self._found = xp.minimum(xp.maximum(found, self._low), self._high)

    def _late(self, now: Array) -> Array:
        """Return the delay lines' values at the time minus the delay, as mj_readCtrl does.

        Args:
            now: what is sent to the actuators with a line in the rows with a delay, (n, L).
        """
        xp = self._arrays.xp
        newest = xp.astype(self._history[self._newest], xp.int64)  # (n, L)
        when = self._plant.time[self._when][:, None] - self._delay
        t0, t1, v0, v1 = self._around(newest, when + self._same)
        span = xp.where(t1 > t0, t1 - t0, 1.0)
        weight = xp.minimum(xp.maximum((when - t0) / span, 0.0), 1.0)
        if self._stepped is not None:
            weight = xp.where(self._stepped, xp.floor(weight + self._same / span), weight)
        late = v0 + weight * (v1 - v0)
        return late if self._in_time is None else xp.where(self._in_time, now, late)

    def _around(self, newest: Array, when: Array) -> Array:
        """Return times and values of the samples before and after a time, (4, n, L).

        The sample after it, counted from the oldest one, mostly is the same as in the substep
        before; where it is not, all of the line is looked at.
        """
        found = self._pair(newest)
        right = (found[0] <= when) | self._first_one
        right &= (found[1] > when) | self._last_one
        if right.all():
            return found
        xp, after = self._arrays.xp, self._after
        for line in np.flatnonzero(self._arrays.host(~xp.all(right, axis=0))):
            wrong, first, count = ~right[:, line], self._first[line] + 2, self._samples[line]
            own = self._history[self._rows[wrong], first : first + count]  # (n, samples)
            before = xp.sum(own <= when[wrong, line][:, None], axis=1)
            after[wrong, line] = xp.clip(before, 1, count - 1)
        self._look(after)
        return self._pair(newest)

    def _look(self, after: Array) -> None:
        """Keep which sample comes after the time in question, counted from the oldest, (n, L)."""
        self._after, self._pairs = after, self._arrays.xp.stack([after, after + 1])
        self._first_one, self._last_one = after == 1, after == self._length - 1

    def _pair(self, newest: Array) -> Array:
        times = self._times + (newest + self._pairs) % self._length  # (2, n, L)
        places = self._arrays.xp.concat([times, times + self._length])
        return self._history[self._rows[:, None], places]


def control_range(plant: PlantView, rows: np.ndarray | slice) -> np.ndarray:
    """Return the range to which the engine clamps each control, (n, nu, 2)."""
    model, expanded = plant.model, plant.batch.expanded("actuator_ctrlrange")
    limited = model.actuator_ctrllimited.astype(bool)[:, None]
    if expanded is None:
        own = np.where(limited, model.actuator_ctrlrange, UNBOUNDED)
        return np.broadcast_to(own, (len(plant.ctrl[rows]), *own.shape))
    return expanded[rows] if limited.all() else np.where(limited, expanded[rows], UNBOUNDED)
