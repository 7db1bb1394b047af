"""Intervals of values: profiled over what else may share the gap.

    ends, correlation = compute_intervals(judgement)            # (P, 2), (P, P)

The curvature of the log density at the answer, (J' V^-1 J) with V the covariance of everything that
nobody knows, usual errors at their full prior, is inverted together with the directions of the
effects that are equivalent to a cause, each with its own prior width: what one of them may share,
the interval says (profile likelihood, to second order; Pawitan 2001). Where the two folds disagree
by more, that counts. To it comes that no robot keeps to the law in which a value is found.
"""

from collections.abc import Sequence

import numpy as np
from scipy.stats import norm

from sim2real.diagnosis.inference.candidates import FREE
from sim2real.diagnosis.inference.fit import Fit, Fitter
from sim2real.diagnosis.inference.hypotheses import Member, get_size
from sim2real.diagnosis.inference.moves import are_compatible, join_members
from sim2real.diagnosis.inference.replayer import Job
from sim2real.diagnosis.inference.score import FOLDS

COVERAGE = 0.9  # of an interval


def compute_intervals(
    fitter: Fitter, fit: Fit, others: Sequence[Member]
) -> tuple[np.ndarray, np.ndarray]:
    """Return 90 % intervals of a fit's values, (P, 2), and their correlations, (P, P).

    The others are changes that are equivalent to one of its members.
    """
    count = fit.values.shape[1]
    if not count:
        return np.zeros((0, 2)), np.zeros((0, 0))
    settings = fitter.settings
    step = np.maximum(
        settings.difference * np.abs(fit.mean), settings.difference_min * fit.hypothesis.size
    )
    step = np.where(fit.hypothesis.smooth, step, 0.0)
    jobs = [(fit.hypothesis, fit.values + step * row) for row in np.eye(count)]
    sizes = list(step)
    prior = list(settings.reach * fit.hypothesis.size)
    for other in (one for one in others if are_compatible(fit.hypothesis, one)):
        for place, size in enumerate(get_size(other)):
            own = other.neutral.copy()
            own[place] += settings.difference * size
            start = join_members(fit, (other,), np.clip(own, other.low, other.high)[None])
            jobs.append((start.hypothesis, start.points[0]))
            sizes.append(settings.difference * size)
            prior.append(settings.reach * size)
    every, fold = fitter.replayer.every, fitter.fold
    made = fitter.replayer.replay([Job(h, values[fold], every) for h, values in jobs])
    safe = np.where(np.array(sizes) == 0, 1.0, sizes)
    slopes = [(one.error - fit.own) / size for one, size in zip(made, safe, strict=True)]
    vectors = np.stack(slopes, axis=-1)
    curve = fitter.curvature(fit, vectors, tempered=False)
    covariance = np.linalg.inv(curve + np.diag(1 / np.square(prior)))[:count, :count]
    spread = np.sqrt(np.diag(covariance))
    # the mean of two folds' values is off by half of what they differ
    apart = np.abs(fit.values[0] - fit.values[1]) / FOLDS
    neutral = np.concatenate([member.neutral for member in fit.hypothesis.members])
    far = np.abs(np.where(neutral >= FREE, fit.mean, fit.mean - neutral))
    total = np.hypot(np.maximum(spread, apart), settings.law * far)
    width = norm.ppf((1 + COVERAGE) / 2) * total
    width = np.where(fit.hypothesis.smooth, width, 0.0)
    ends = fit.hypothesis.clip(np.stack([fit.mean - width, fit.mean + width]))
    return ends.T, covariance / np.outer(spread, spread)
