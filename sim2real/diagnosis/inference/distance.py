"""How far apart two explanations predict, in nats: the one measure of equivalence.

    compute_separation(fitter, one, other)                          # after both were fitted
    Distance(fitter, bootstrap, count).distinguishes(best, other)   # by these windows

If one explanation is true, recordings like these are expected to favour it by half the squared
distance of the predictions under the covariance of what neither knows: the Kullback-Leibler
divergence of two Gaussians of one covariance (Box and Hill 1967 choose experiments by it). What
starts, usual errors and the discrepancy may make does not part them.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from sim2real.diagnosis.inference.fit import Fit, Fitter, Start
from sim2real.diagnosis.inference.hypotheses import Hypothesis, get_kind
from sim2real.diagnosis.inference.products import HALF
from sim2real.diagnosis.inference.score import Bootstrap

ROUNDS = 3  # Gauss-Newton steps from one fit to what another predicts: they are close
APART = 2  # members by which an explanation is another one


def compute_separation(fitter: Fitter, one: Fit, other: Fit) -> float:
    """Return the expected log ratio of two fits' densities on these windows [nats].

    The discrepancy of the first counts; the fitter made both. The other is fitted to what the first
    predicts: values fitted to a log are as far apart as the log leaves them uncertain. It begins
    at its own values and at the first's, which are the same if one physics has two names.
    """
    points = [fit.values for fit in (other, one) if fit.values.shape == other.values.shape]
    start = Start(other.hypothesis, np.stack(points))
    (near,) = fitter.imitating(one).fit([start], rounds=ROUNDS)
    return float(fitter.curvature(one, near.own[..., None])[0, 0]) * HALF


class Distance:
    """Which explanations the windows distinguish, by more than an encoder count.

    As for what is left of a gap, a model that is off by a count is right: they are compared with a
    discrepancy of a count or more: of each joint, in noises, (M,).
    """

    def __init__(self, fitter: Fitter, bootstrap: Bootstrap, count: np.ndarray) -> None:
        self._fitter, self._bootstrap, self._count = fitter, bootstrap, count
        self._scores: dict[Fit, np.ndarray] = {}  # (W,) nats

    def score(self, fitter: Fitter, fit: Fit) -> np.ndarray:
        """Return the score of a fit, (W,) nats, by the fitter that made it; it is kept."""
        if fit not in self._scores:
            (self._scores[fit],) = fitter.score_within(fit, [(self._count, np.inf)], near=True)
        return self._scores[fit]

    def distinguishes(self, best: Fit, other: Fit) -> bool:
        """Return whether these windows distinguish the best from another explanation.

        They do where it predicts significantly better, and with odds of one over the level:
        readings are no independent evidence, so odds change by e for each `temperature` nats a row.
        """
        scores = [self.score(self._fitter, fit) for fit in (best, other)]
        gain, settings = self._bootstrap.gain(scores[0] - scores[1]), self._fitter.settings
        odds = gain.total / self._fitter.replayer.compared / settings.temperature
        return gain.low > 0 and odds > math.log(1 / settings.level)


def stands_alone(best: Fit, others: Sequence[Fit], distinct: Callable[[Fit], bool]) -> bool:
    """Return whether no explanation as long as the best does as well with quite other causes.

    One other member is an equivalent of the one in whose place it stands. Two are no names, unless
    each stands for one of the best by itself as well. `distinct` says whether the windows
    distinguish a fit from the best.
    """
    own = _labels(best)
    rivals = [one for one in others if len(_labels(one)) == len(own)]
    rivals = [one for one in rivals if not distinct(one)]
    alike = own.union(*(_labels(one) for one in rivals if len(_labels(one) - own) < APART))
    return all(len(_labels(one) - alike) < APART for one in rivals)


def share_joint(hypothesis: Hypothesis, joints: int) -> bool:
    """Return whether two effects are at one joint of a robot that has others: so many `joints`.

    Independent causes seldom meet there, while a law that is missing is imitated where it acts.
    """
    places = [m.place for m in hypothesis.members if get_kind(m) == "robot"]
    own = [place for place in places if place is not None]
    return joints > 1 and len(own) > len(set(own))


def _labels(fit: Fit) -> set[str]:
    return {member.label for member in fit.hypothesis.members}
