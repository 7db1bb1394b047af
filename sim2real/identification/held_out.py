"""What a distribution makes of recordings that nothing was fitted to.

    judged = judge(held, found, np.random.default_rng(0))
    judged.before, judged.after, judged.coverage

Held-out recordings are replayed under draws of the distribution, each with what was left of the gap
added as noise: a band that holds nine tenths of the draws should hold about nine tenths of the
readings. CRPS is the continuous ranked probability score of these draws (Gneiting and Raftery 2007,
the ensemble's form); an estimate without a width scores its absolute error.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from envs.distribution import Distribution
from sim2real.identification.providers.base import Aligned
from sim2real.identification.settings import DEFAULT, Settings


class Judged(NamedTuple):
    """Held-out numbers; gaps are root mean squares over all readings, in units of their scale."""

    before: float  # the gap with the effects absent
    after: float  # with the distribution's mean
    coverage: float  # share of the readings within the band of the draws
    band: float  # share of the draws that the band holds
    crps: float  # of the draws
    absolute: float  # mean absolute error of the distribution's mean


def judge(
    held: Aligned, found: Distribution, rng: np.random.Generator, settings: Settings = DEFAULT
) -> Judged:
    """Judge a distribution by recordings.

    Args:
        held: what was held out.
        found: the distribution.
        rng: for draws and noise.
        settings: `draws`, `band` and `compared` are used.
    """
    neutral = np.clip(held.neutral, found.low, found.high)[None]
    before, after = held.errors(np.concatenate([neutral, found.mean[None]]))
    drawn = held.errors(found.sample(rng, settings.draws))  # (D, W, T, M)
    noise = np.array([found.noise[name] for name in held.names]) / held.scale  # (M,)
    drawn = drawn + noise * rng.standard_normal(drawn.shape)
    there = np.isfinite(held.real)
    errors = drawn[:, there]  # (D, n)
    if errors.shape[1] > settings.compared:
        errors = errors[:, rng.choice(errors.shape[1], settings.compared, replace=False)]
    tail = (1 - settings.band) / 2
    low, high = np.quantile(errors, [tail, 1 - tail], axis=0)
    return Judged(
        _rms(before),
        _rms(after),
        float(((low <= 0) & (high >= 0)).mean()),
        settings.band,
        crps(errors),
        float(np.nanmean(np.abs(after))),
    )


def crps(errors: np.ndarray) -> float:
    """Return the mean CRPS of an ensemble's errors (D, n), the smaller the better.

    mean |x| - mean |x - x'| / 2; the second mean from sorted values, where the i-th of D counts
    2 i - D - 1 times.
    """
    count = len(errors)
    ranks = 2 * np.arange(1, count + 1) - count - 1  # (D,)
    within = (ranks[:, None] * np.sort(errors, axis=0)).sum(axis=0) / count**2
    return float((np.abs(errors).mean(axis=0) - within).mean())


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(error**2)))
