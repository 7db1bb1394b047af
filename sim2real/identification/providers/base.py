"""The interface of providers: measured data, and the same data as simulated.

    sample = provider.simulate(values, turn=0)      # (n, ...), to compare with provider.real (...)

An aligned provider compares row by row: real (W, T, M) is W pieces of T rows and M readings, NaN
where nothing is compared, and each piece belongs to an episode. Any other compares transitions:
real (N, F) and simulated (n, N', F) are samples of two distributions.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from typing import Protocol

import numpy as np

from envs.effects import Effect
from sim2real.identification.data import Recordings
from sim2real.identification.settings import DEFAULT, Settings

HELD = 0  # the stream of randomness of what is held out


class Provider(Protocol):
    """Base class of providers of simulated data."""

    aligned: bool
    real: np.ndarray
    neutral: np.ndarray  # (P,) values at which the effects are absent

    def simulate(self, values: np.ndarray, turn: int = 0) -> np.ndarray:
        """Return the data as simulated under values (n, P), (n, ...).

        Args:
            values: of the effects' parameters.
            turn: decides the seeds of what is random; the same turn gives the same simulations.
        """
        ...


class MakeProvider(Protocol):
    """Makes a provider of data and effects; `rows` is what the score compares (`Score.rows`)."""

    def __call__(
        self, data: Recordings, effects: Sequence[Effect], *, rows: int | None, seed: int
    ) -> Provider:
        """Make it."""
        ...


class AlignedProvider(ABC):
    """A provider whose simulations belong to the measured rows.

    Attributes:
        real: what was measured, (W, T, M), over `scale`; NaN where nothing is compared.
        episode: the episode of each piece, (W,), numbered from 0.
        chunk: what is held out together where episodes are too few, (W,).
        scale: what readings are divided by, (M,).
        names: of the M readings.
        floor: noise of a reading, over scale, (M,).
        neutral: values at which the effects are absent, (P,).
    """

    aligned = True

    def __init__(
        self,
        real: np.ndarray,
        episode: np.ndarray,
        scale: np.ndarray,
        names: Sequence[str],
        floor: np.ndarray,
        neutral: np.ndarray,
        chunk: np.ndarray | None = None,
    ) -> None:
        self.real, self.scale, self.names = real, scale, tuple(names)
        self.floor, self.neutral = floor, neutral
        self.episode = np.unique(episode, return_inverse=True)[1]
        self.chunk = np.arange(len(real)) if chunk is None else chunk
        self.chosen = np.arange(len(real))

    @abstractmethod
    def errors_of(self, pieces: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return simulated minus measured over scale, (R, T, M), of pieces (R,), values (R, P)."""

    @property
    def episodes(self) -> int:
        """E, the number of episodes."""
        return int(self.episode.max()) + 1

    def errors(self, values: np.ndarray) -> np.ndarray:
        """Return simulated minus measured, over scale, (n, W, T, M); NaN where nothing is compared.

        Args:
            values: (n, P), or (n, E, P) where each episode has its own.
        """
        n, count = len(values), len(self.chosen)
        each = values[:, self.episode] if values.ndim > 2 else np.repeat(values[:, None], count, 1)
        found = self.errors_of(np.tile(self.chosen, n), each.reshape(n * count, -1))
        found = found.reshape(n, count, *found.shape[1:])
        return np.where(np.isnan(self.real), np.nan, found)

    def simulate(self, values: np.ndarray, turn: int = 0) -> np.ndarray:
        """Return the data as simulated under values, (n, W, T, M)."""
        return self.real + self.errors(values)

    def subset(self, pieces: np.ndarray) -> AlignedProvider:
        """Return the same with some of its pieces, (n,) indices; their episodes are renumbered."""
        other = copy(self)
        other.real, other.chunk = self.real[pieces], self.chunk[pieces]
        other.chosen = self.chosen[pieces]
        other.episode = np.unique(self.episode[pieces], return_inverse=True)[1]
        return other

    def split(self, settings: Settings = DEFAULT) -> tuple[AlignedProvider, AlignedProvider]:
        """Return the data that are fitted to and those that are held out.

        Whole episodes are held out where there are enough of them, else stretches of all; of a
        single piece nothing can be spared, and both are the same.
        """
        group = self.episode if self.episodes >= settings.held_episodes else self.chunk
        number = np.unique(group, return_inverse=True)[1]
        count = int(number.max()) + 1
        order = np.random.default_rng(HELD).permutation(count)  # names in turn may mean something
        held = np.isin(number, order[: max(count // settings.held_every, 1)])
        if held.all():
            return self, self
        return self.subset(np.flatnonzero(~held)), self.subset(np.flatnonzero(held))
