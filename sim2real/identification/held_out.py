"""Score a parameter distribution on held-out recordings.

    found = widened(fitted, found, np.random.default_rng(0))
    judged = judge(held, found, np.random.default_rng(0))
    judged.before, judged.after, judged.coverage

Held-out recordings are replayed under draws of the distribution, each with what was left of the gap
added as noise: a band that holds nine tenths of the draws should hold about nine tenths of the
readings. The noise level comes from the recordings that were fitted. CRPS is the
continuous ranked probability score of these draws (Gneiting and Raftery 2007, the ensemble's form);
an estimate without a width scores its absolute error.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from envs.distribution import Distribution
from sim2real.identification.providers.base import AlignedProvider
from sim2real.identification.settings import DEFAULT, Settings

HALVINGS = 16  # of the interval in which enough noise is looked for


class HeldOutScores(NamedTuple):
    """Held-out numbers; gaps are root mean squares over all readings, in units of their scale."""

    before: float  # the gap with the effects absent
    after: float  # with the distribution's mean
    coverage: float  # share of the readings within the band of the draws
    band: float  # share of the draws that the band holds
    crps: float  # of the draws
    absolute: float  # mean absolute error of the distribution's mean


def inflate_noise(
    fitted: AlignedProvider,
    found: Distribution,
    rng: np.random.Generator,
    settings: Settings = DEFAULT,
) -> Distribution:
    """Return the distribution with the noise that its draws lack to hold the fitted readings.

    What no parameter says shows where parameters change little, too. Each joint's noise, which is a
    lower bound, grows until the band of noisy draws holds as many of its readings as it should.
    """
    few = max(1, int(settings.compared // max(fitted.real[0].size, 1)))
    pieces = np.sort(rng.permutation(len(fitted.real))[:few])
    some = fitted.subset(pieces)
    drawn = some.errors(found.sample(rng, settings.draws))  # (D, W, T, M)
    noise = {}
    for place, name in enumerate(some.names):
        own = drawn[:, np.isfinite(some.real[..., place]), place]  # (D, n)
        least = found.noise[name] / some.scale[place]
        noise[name] = _enough(own, least, rng, settings.band) * float(some.scale[place])
    return replace(found, noise=noise)


def _enough(errors: np.ndarray, least: float, rng: np.random.Generator, band: float) -> float:
    """Return the noise, at least `least`, with which a band of errors (D, n) holds its share."""
    made = rng.standard_normal(errors.shape)
    low, high = float(least), max(4 * _rms(errors), 2 * float(least))
    if not errors.size or _share(errors + low * made, band) >= band:
        return low
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        enough = _share(errors + middle * made, band) >= band
        low, high = (low, middle) if enough else (middle, high)
    return high


def _share(errors: np.ndarray, band: float) -> float:
    """Return the share of readings (n,) that lie within the band of errors (D, n)."""
    tail = (1 - band) / 2
    low, high = np.quantile(errors, [tail, 1 - tail], axis=0)
    return float(((low <= 0) & (high >= 0)).mean())


def score_held_out(
    held: AlignedProvider, found: Distribution, rng: np.random.Generator
) -> HeldOutScores:
    """Judge a distribution by the recordings that were held out."""
    neutral = np.clip(held.neutral, found.low, found.high)[None]
    before, after = held.errors(np.concatenate([neutral, found.mean[None]]))
    drawn = held.errors(found.sample(rng, DEFAULT.draws))  # (D, W, T, M)
    noise = np.array([found.noise[name] for name in held.names]) / held.scale  # (M,)
    drawn = drawn + noise * rng.standard_normal(drawn.shape)
    there = np.isfinite(held.real)
    errors = drawn[:, there]  # (D, n)
    if errors.shape[1] > DEFAULT.compared:
        errors = errors[:, rng.choice(errors.shape[1], DEFAULT.compared, replace=False)]
    return HeldOutScores(
        _rms(before),
        _rms(after),
        _share(errors, DEFAULT.band),
        DEFAULT.band,
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
