"""A fit on its way: the best values of each fold so far.

gain = state.take(other, fold)          # what the other does better, in nats of each fold
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.likelihood import Trained
from sim2real.diagnosis.inference.replayer import Replay
from sim2real.diagnosis.inference.score import FOLDS
from sim2real.diagnosis.settings import TINY

BETTER = 0.05  # nats: gains below it are rounding


class State:
    """The best values of each fold so far, and the errors there."""

    def __init__(
        self,
        hypothesis: Hypothesis,
        values: np.ndarray,
        replay: Replay,
        trained: Sequence[Trained],
    ) -> None:
        self.hypothesis, self.values, self.replay = hypothesis, values.copy(), replay
        self.trained = list(trained)
        self.density = np.array([one.density for one in trained])
        self.damping, self.failed = np.zeros(FOLDS), np.zeros(FOLDS, int)
        self.gain = np.zeros(FOLDS)  # of the last step [nats]
        self.places = np.flatnonzero(hypothesis.smooth)
        self.slopes: Any = None  # (W, N, M, P) of the errors, None: unknown
        self.fresh = False  # whether they are those of the present values

    @property
    def is_apart(self) -> bool:
        """Whether the folds have values of their own."""
        return bool((self.values[0] != self.values[1]).any())

    def take(self, other: State, fold: np.ndarray) -> np.ndarray:
        """Take over what the other does better in a fold; return the gains [nats], (2,)."""
        gain = other.density - self.density
        better = gain > BETTER
        own = better[fold]
        parts = zip(self.replay, other.replay, strict=True)
        self.replay = Replay(*(np.where(widen(own, b), b, a) for a, b in parts))
        for side in np.flatnonzero(better):
            self.values[side], self.density[side] = other.values[side], other.density[side]
            self.trained[side] = other.trained[side]
        return gain

    def join(self, others: Sequence[State]) -> np.ndarray | None:
        """Return the values, (2, P), with each change that gains in a fold; None below two.

        Each of the others changes one value.
        """
        if len(others) < 2:
            return None
        changes = np.array([other.values - self.values for other in others])
        gains = np.array([other.density - self.density for other in others])
        gains = np.where(changes != 0, gains[..., None], 0.0)
        best = np.take_along_axis(changes, gains.argmax(axis=0)[None], axis=0)[0]
        better = gains.max(axis=0) > BETTER
        return self.values + np.where(better, best, 0.0) if better.sum(axis=1).max() > 1 else None

    def within_reach(self, best: float, rounds: int) -> bool:
        """Return whether so many steps, like the last unless it failed, may lead to a density."""
        return not self.gain.any() or self.density.sum() + self.gain.sum() * rounds >= best

    def nudges(self, share: float, least: float) -> np.ndarray:
        """Return a step of each coordinate for finite differences, (2, P), inside its bounds.

        Nor does it lead to where readings stand in other rows, see `Hypothesis.crosses`.
        """
        linear = self.hypothesis.to_linear(self.values)
        step = np.maximum(share * np.abs(linear), least * self.hypothesis.linear_size)
        step = np.where(linear + step > self.hypothesis.high, -step, step)
        return np.where(self.hypothesis.crosses(self.values, linear + step), -step, step)

    def moved(self, change: np.ndarray) -> np.ndarray:
        """Return the values after a change of their coordinates, (2, P) both."""
        return self.hypothesis.from_linear(self.hypothesis.to_linear(self.values) + change)

    def learn(self, step: np.ndarray, change: np.ndarray, fold: np.ndarray) -> None:
        """Let the slopes say how errors changed, (W, N, M), by a step of coordinates, (2, P)."""
        step = step[:, self.places]
        scaled = step / np.square(self.hypothesis.linear_size[self.places])
        scaled /= np.maximum((scaled * step).sum(axis=1, keepdims=True), TINY)
        missed = change - np.einsum("wnmp,wp->wnm", self.slopes, step[fold])
        self.slopes += missed[..., None] * scaled[fold][:, None, None]


def widen(values: np.ndarray, like: np.ndarray) -> np.ndarray:
    """Return values (W,) with as many axes as an array (W, ...)."""
    return values.reshape(-1, *[1] * (like.ndim - 1))
