"""Which small errors of the model's parameters account for what an explanation leaves.

    find_deviations(judgement)          # position_gain at hinge: -0.054 [-0.061, -0.047]

They are no causes, and the likelihood integrates them out. What the errors tell of each is its
posterior, see `Likelihood.estimate`: it means something only where nothing else is missing.
"""

import numpy as np
from scipy.stats import norm

from sim2real.diagnosis.inference.intervals import COVERAGE
from sim2real.diagnosis.inference.judge import Judgement
from sim2real.diagnosis.inference.score import FOLDS
from sim2real.diagnosis.inference.unknowns import cap_directions
from sim2real.diagnosis.inference.usual import list_usual
from sim2real.diagnosis.schema import Deviation
from sim2real.diagnosis.settings import TINY


def find_deviations(judgement: Judgement) -> tuple[Deviation, ...]:
    """Return the errors that are significant if nothing else is missing, the largest first.

    The level is shared among all parameters (Bonferroni). Each fold has an estimate of its own;
    the mean is off by half of what they differ, or more. None where something else is missing.
    """
    judge, best = judgement.judge, judgement.best
    factors = list(list_usual(judge.data, best.hypothesis.effects))
    fitter, settings = judge.fitter, judge.settings
    if not factors or not judge.left(best)._replace(usual=True).is_nothing(settings):
        return ()
    ways = judge.coarse.usual(best.hypothesis, best.values[judge.fold])
    ways = cap_directions(judge.coarse, ways)
    pairs = zip(best.trained, fitter.sides, strict=True)
    sides = [fitter.likelihood.estimate(one, best.own, ways, windows) for one, windows in pairs]
    means, variances = np.moveaxis(np.array(sides), 1, 0)  # (2, U) each
    mean = -means.mean(axis=0)  # errors are what the model does less what the robot does
    spread = np.sqrt(np.maximum(variances.mean(axis=0), TINY))
    spread = np.maximum(spread, np.abs(means[0] - means[1]) / FOLDS)
    clear = np.abs(mean) > norm.isf(settings.level / len(factors) / 2) * spread
    half = norm.ppf((1 + COVERAGE) / 2) * spread
    change, ends = settings.usual * mean, settings.usual * np.array([mean - half, mean + half])
    return tuple(
        Deviation(
            factors[n].name,
            factors[n].effect.where,
            float(change[n]),
            (float(ends[0, n]), float(ends[1, n])),
            factors[n].effect.variant,
        )
        for n in np.argsort(-np.abs(mean))
        if clear[n]
    )
