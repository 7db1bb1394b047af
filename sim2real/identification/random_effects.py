"""A robot's variance between episodes, separate from the uncertainty of its mean.

    split = random_effects(estimates, covariances)       # (E, P), (E, P, P)
    split.mean, split.spread, split.uncertainty          # (P,), (P, P), (P, P)
    shrunk(split.spread, len(estimates))                 # less of what few episodes have by chance

The model of a meta-analysis: an episode's true value is N(mean, spread), its estimate is
N(true value, covariance). Spread by restricted maximum likelihood, by an EM algorithm (Laird and
Ware, Biometrics 38, 1982); the mean's uncertainty is that of generalized least squares.
"""

from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.settings import TINY, TINY_SQUARE
from sim2real.identification.settings import DEFAULT, Settings


class VarianceComponents(NamedTuple):
    """A mean, and two covariances."""

    mean: np.ndarray  # (P,)
    spread: np.ndarray  # (P, P) between episodes; zeros of one episode
    uncertainty: np.ndarray  # (P, P) of the mean


def random_effects(
    estimates: np.ndarray, covariances: np.ndarray, settings: Settings = DEFAULT
) -> VarianceComponents:
    """Split the scatter of episodes' estimates.

    Args:
        estimates: of E episodes, (E, P).
        covariances: how well each is known, (E, P, P), positive definite.
        settings: `em_rounds` and `em_change` are used.
    """
    count, size = estimates.shape
    if count == 1 or size == 0:
        return VarianceComponents(estimates[0], np.zeros((size, size)), covariances[0])
    spread = np.atleast_2d(np.cov(estimates.T)) + TINY * np.eye(size)
    for _ in range(settings.em_rounds):
        mean, inverse, uncertainty = _mean(estimates, covariances, spread)
        gain = spread @ inverse  # (E, P, P): how much of an estimate is believed
        apart = estimates - mean
        scatter = apart[:, :, None] * apart[:, None] + uncertainty
        new = (gain @ scatter @ gain.transpose(0, 2, 1) + spread - gain @ spread).mean(axis=0)
        new = (new + new.T) / 2
        done = np.abs(new - spread).max() <= settings.em_change * np.abs(spread).max()
        spread = new
        if done:
            break
    mean, _, uncertainty = _mean(estimates, covariances, spread)
    return VarianceComponents(mean, spread, uncertainty)


def shrink_correlations(covariance: np.ndarray, count: int) -> np.ndarray:
    """Return a covariance of few episodes with smaller correlations, (P, P).

    Correlations r of n episodes have variances of about (1 - r^2)^2 / (n - 1). All are multiplied
    by 1 - w, where w is the sum of these over that of r^2, at most 1 (Schäfer and Strimmer,
    Statistical Applications in Genetics and Molecular Biology 4, 2005).

    Args:
        covariance: of the episodes' values, (P, P).
        count: of episodes, at least two.
    """
    deviations = np.sqrt(np.maximum(np.diag(covariance), TINY_SQUARE))
    squares = (covariance / np.outer(deviations, deviations))[np.triu_indices_from(covariance, 1)]
    squares = np.clip(squares**2, 0.0, 1.0)
    chance = float(np.sum((1 - squares) ** 2)) / (count - 1)
    weight = min(chance / max(float(np.sum(squares)), TINY), 1.0)
    return (1 - weight) * covariance + weight * np.diag(np.diag(covariance))


def _mean(
    estimates: np.ndarray, covariances: np.ndarray, spread: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the weighted mean (P,), the weights (E, P, P) and the mean's covariance (P, P)."""
    inverse = np.linalg.inv(covariances + spread)
    uncertainty = np.linalg.inv(inverse.sum(axis=0))
    mean = uncertainty @ np.einsum("epq,eq->p", inverse, estimates)
    return mean, inverse, uncertainty
