"""Which windows a fit looks at, and what each counts.

problem.subset(lively(data, error, seconds=15.0), tempered(data, error))
"""

from __future__ import annotations

import numpy as np

from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.settings import TINY_SQUARE


def tempered(data: Data, error: np.ndarray) -> np.ndarray:
    """Return what each window counts in a fit, (W,): 1, less for the few with by far most error.

    A joint that swings freely in the model and sticks on the robot would outweigh everything else.
    """
    own = np.sqrt(data.window_squares(error))
    limit = float(np.quantile(own, data.settings.search.heavy, method="lower"))
    return np.minimum(1.0, max(limit, TINY_SQUARE) / np.maximum(own, TINY_SQUARE))


def lively(data: Data, error: np.ndarray, seconds: float) -> np.ndarray:
    """Return windows of about so many seconds in all.

    Of each model and each fold some, by turns the one with most error and one of those spread
    evenly from calm to lively.
    """
    lengths = np.array([w.sample[-1, 0] - w.sample[0, 0] for w in data.windows])
    if lengths.sum() <= seconds:
        return np.arange(len(lengths))
    weight = data.window_squares(error)
    model = np.array([w.model for w in data.windows])
    speed = np.array([w.lively for w in data.windows])
    groups = [np.flatnonzero((model == m) & (data.fold == f)) for m in set(model) for f in (0, 1)]
    chosen: list[int] = []
    for rank in range(len(lengths)):
        if lengths[chosen].sum() >= seconds and rank > 0:
            break
        for group in groups:
            worst, line = group[np.argsort(-weight[group])], group[np.argsort(speed[group])]
            spread = np.roll(line[::-1], data.settings.search.stride * rank)
            pick = worst if rank % len((worst, spread)) == 0 else spread
            chosen += [int(i) for i in pick if i not in chosen][:1]
    return np.sort(np.array(chosen))
