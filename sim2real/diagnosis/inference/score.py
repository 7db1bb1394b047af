"""How much better one explanation predicts held-out stretches than another.

    fold = deal_folds(data.windows)                       # (W,) 0 or 1
    bounds = Bootstrap(rng, settings).gain(one - other)   # mean, low, high of a sum over windows

Log predictive densities are compared window by window (Gelman, Hwang and Vehtari 2014,
doi:10.1007/s11222-013-9416-2): what makes a window hard is in both of them, and differences of
neighbours, which share what is wrong, are drawn together (block bootstrap, Kuensch 1989).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.data.windows import Window
from sim2real.diagnosis.settings.inference import Inference

FOLDS = 2
OFF = 0.05  # share of the time without torque from which a window shows what the joint does alone
TURNS = np.array([0, 1, 1, 0])


class Gain(NamedTuple):
    """A sum over windows [nats], and its one-sided bounds."""

    total: float
    low: float
    high: float


def deal_folds(windows: Sequence[Window]) -> np.ndarray:
    """Return 0 or 1 for each window, so that both folds see every regime.

    Windows without torque and with it are dealt by themselves, in the order of their speed, those
    of every log: 0 1 1 0. No fold owns an episode: a log that alone shows something is in both.
    """
    fold = np.zeros(len(windows), int)
    for free in (False, True):
        own = [n for n, w in enumerate(windows) if (w.off > OFF) == free]
        own.sort(key=lambda n: (windows[n].log, windows[n].lively))
        turns = TURNS if not free else 1 - TURNS
        fold[own] = np.resize(turns, len(own))
    return fold


class Bootstrap:
    """Draws of blocks of windows, neighbours in an episode, the same for every comparison."""

    def __init__(
        self, windows: Sequence[Window], rng: np.random.Generator, settings: Inference
    ) -> None:
        blocks = _blocks(windows, settings.block)
        count = int(blocks.max()) + 1
        weight = rng.multinomial(count, np.full(count, 1 / count), settings.draws)
        self._weight = weight[:, blocks]  # (draws, W)
        self._level = settings.level

    def gain(self, difference: np.ndarray) -> Gain:
        """Return the sum of differences (W,) with its bounds."""
        sums = self._weight @ difference
        low, high = np.quantile(sums, [self._level, 1 - self._level])
        return Gain(float(difference.sum()), float(low), float(high))


def _blocks(windows: Sequence[Window], size: int) -> np.ndarray:
    """Return the block of each window, (W,): so many neighbours of an episode."""
    order = sorted(range(len(windows)), key=lambda n: (windows[n].log, windows[n].start))
    found, number, inside, before = np.zeros(len(windows), int), -1, 0, None
    for place in order:
        episode = windows[place].log, windows[place].episode
        if episode != before or inside == size:
            number, inside, before = number + 1, 0, episode
        found[place], inside = number, inside + 1
    return found
