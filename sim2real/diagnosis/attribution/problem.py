"""What a fit looks at: windows, how they are simulated, and what errors on them cost.

    problem = Problem(data, simulator)
    error, slope = problem.errors(members, points)          # under points (K, 2, P), one a fold
    problem.held_out(members, values)                       # judged under the other fold's values

Windows of fold f are simulated under the values of fold f, and to be judged under those of the
other one. A shift of the clock by less than a simulation step, or half of one, is fitted along,
since no log knows its stamps better.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from sim2real.diagnosis.attribution.batches import Rows, simulate_each
from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.simulate import Simulator
from sim2real.diagnosis.settings import TINY_SQUARE

FOLDS = 2


class Fitted(Protocol):
    """Members with their values, (2, P)."""

    @property
    def members(self) -> tuple[Candidate, ...]:
        """The effects."""
        ...

    @property
    def values(self) -> np.ndarray:
        """One row for each fold."""
        ...


class Ask(NamedTuple):
    """What a fit wants to see simulated."""

    members: tuple[Candidate, ...]
    points: np.ndarray  # (K, 2, P) values of their parameters, one row for each fold


class Problem:
    """Data, its simulator and the windows that a fit looks at.

    Args:
        data: the windows.
        simulator: of these windows.
        chosen: indices of the windows to look at, (n,); None for all.
        weight: what the errors of each window of the data count, (W,); None: all are 1.
    """

    def __init__(
        self,
        data: Data,
        simulator: Simulator,
        chosen: np.ndarray | None = None,
        weight: np.ndarray | None = None,
    ) -> None:
        self.data, self.simulator = data, simulator
        self.settings = data.settings.fitting
        self.windows = np.arange(len(data.windows)) if chosen is None else np.sort(chosen)
        self.fold = data.fold[self.windows]
        self.weight = None if weight is None else weight[self.windows]
        self.clock = _clock(data)
        self.rows = data.mask[self.windows].sum() * len(data.joints)
        self.offset: np.ndarray | None = None  # (n, T, M) that the simulator's errors lack

    def subset(self, chosen: np.ndarray, weight: np.ndarray | None = None) -> Problem:
        """Return the same problem on fewer windows, (n,) indices, that count so much, (W,)."""
        return Problem(self.data, self.simulator, chosen, weight)

    def by(self, simulator: Simulator, offset: np.ndarray | None = None) -> Problem:
        """Return the same problem, simulated by another simulator of the same windows.

        Its errors get an offset, (n, T, M) on these windows: by how much it is known to be off.
        """
        other = copy(self)
        other.__dict__.pop("timing", None)  # that of the other simulator is found anew
        other.simulator, other.offset = simulator, offset
        return other

    def errors(
        self, members: Sequence[Candidate], points: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return errors and clock slopes, (K, W, T, M), under points (K, 2, P), one a fold."""
        return self.errors_each([Ask(tuple(members), points)])[0]

    def errors_each(
        self, asks: Sequence[Ask], remember: bool = True
    ) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return what `errors` does of several asks, simulated side by side.

        `remember` takes what was simulated before from memory; see `simulate_each`.
        """
        sets = []
        for members, points in asks:
            values = points[:, self.fold].reshape(len(points) * len(self.windows), -1)  # (K W, P)
            sets.append(Rows(members, np.tile(self.windows, len(points)), values))
        found = []
        for result in simulate_each(self.simulator, sets, remember):
            shape = (-1, len(self.windows), *result.error.shape[1:])
            error, slope = result.error.reshape(shape), result.slope.reshape(shape)
            weight = 1.0 if self.weight is None else self.weight[:, None, None]
            offset = 0.0 if self.offset is None else self.offset
            found.append((weight * error + offset, weight * slope))
        return found

    def seen(self, error: np.ndarray) -> np.ndarray:
        """Return errors of all windows, (W, T, M), as they count here, (n, T, M)."""
        own = error[self.windows]
        return own if self.weight is None else own * self.weight[:, None, None]

    def shift(self, error: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Return the clock's shift [s] that fits best in each fold, (..., 2), of (..., W, T, M)."""
        across = (error * slope).sum(axis=(-2, -1))  # (..., W)
        along = (slope * slope).sum(axis=(-2, -1))
        found = [
            -across[..., self.fold == f].sum(-1)
            / np.maximum(along[..., self.fold == f].sum(-1), TINY_SQUARE)
            for f in range(FOLDS)
        ]
        return np.clip(np.stack(found, axis=-1), -self.clock, self.clock)

    def cost(self, error: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Return the mean square error of each fold, its clock set, (..., 2)."""
        shift = self.shift(error, slope)[..., self.fold]  # (..., W)
        square = ((error + shift[..., None, None] * slope) ** 2).sum(axis=(-2, -1))
        counts = self.data.mask[self.windows].sum(axis=1) * error.shape[-1]
        found = [
            square[..., self.fold == f].sum(-1) / max(counts[self.fold == f].sum(), 1)
            for f in range(FOLDS)
        ]
        return np.stack(found, axis=-1)

    def held_out(self, members: Sequence[Candidate], values: np.ndarray) -> np.ndarray:
        """Return the errors (W, T, M) of each window under the values (2, P) of the other fold.

        The clock is the other fold's as well.
        """
        return self._held_out([Ask(tuple(members), values)])[0]

    def held_out_each(self, fits: Sequence[Fitted]) -> list[np.ndarray]:
        """Return the held-out errors of several fits, (W, T, M) each, simulated side by side."""
        return self._held_out([Ask(fit.members, fit.values) for fit in fits])

    def _held_out(self, asks: Sequence[Ask]) -> list[np.ndarray]:
        """Return the held-out errors under values (2, P) of each fold."""
        others = self.errors_each([Ask(m, v[None, ::-1]) for m, v in asks])
        own = self.timing.errors_each([Ask(m, v[None]) for m, v in asks])
        found = []
        for (error, slope), timed in zip(others, own, strict=True):
            shift = self.timing.shift(*timed)[0, ::-1]
            found.append(error[0] + shift[self.fold][:, None, None] * slope[0])
        return found

    @cached_property
    def timing(self) -> Problem:
        """The same problem on as many windows as tell a fold's clock, spread evenly over each."""
        times = (self.data.windows[i].sample[:, 0] for i in self.windows)
        seconds = sum(float(time[-1] - time[0]) for time in times)
        every = int(np.ceil(seconds / self.settings.timing_s))
        if every < 2:
            return self
        kept = [self.windows[self.fold == f][::every] for f in range(FOLDS)]
        weight = None
        if self.weight is not None:
            weight = np.ones(len(self.data.windows))
            weight[self.windows] = self.weight
        return self.subset(np.concatenate(kept), weight).by(self.simulator)


def _clock(data: Data) -> float:
    """Return by how much the log's clock may be off [s].

    A command acts from the next step of the simulation on: half a step late in the mean. Beyond
    that, a clock that is free to follow takes lags for its own that are the robot's.
    """
    step = max(model.opt.timestep for model in data.models)
    stamps = [f"stamp.{joint.name}" for joint in data.joints]
    known = all(stamp in log.columns for log in data.logs for stamp in stamps)
    limits = data.settings.fitting
    return limits.stamped_steps * step if known else max(limits.clock_s, step)
