"""Whether a fit explains the gap, and what wins against it: asked of one likelihood at a time.

criteria.left(fit).is_nothing(settings)     # what a free discrepancy gains over one of a count
criteria.choose(tried)                      # the shortest that none longer wins against
"""

from collections.abc import Sequence

import numpy as np

from sim2real.diagnosis.inference.decision import Left, compute_price
from sim2real.diagnosis.inference.distance import Distance
from sim2real.diagnosis.inference.fit import Fit, Fitter, Start
from sim2real.diagnosis.inference.hypotheses import NONE, Hypothesis
from sim2real.diagnosis.inference.replayer import Replayer
from sim2real.diagnosis.inference.score import Bootstrap, Gain
from sim2real.diagnosis.settings import TINY


class Criteria:
    """What is asked of fits to the windows of a replayer; a bootstrap says how sure the answer is.

    It speaks for the likelihood of `use`, and of a vocabulary of so many `choices`.
    """

    def __init__(self, replayer: Replayer, bootstrap: Bootstrap) -> None:
        self.replayer, self.bootstrap = replayer, bootstrap
        self.settings, self.rows, self.choices = replayer.settings, replayer.compared, 1
        self.most = np.maximum(replayer.count, replayer.noise) / replayer.noise  # counts, in noises

    def use(self, fitter: Fitter) -> None:
        """Ask the likelihood of another fitter from now on, which fits the model as given."""
        self.fitter = fitter
        self._lefts: dict[Fit, Left] = {}  # of what was asked, in this likelihood
        self.distance = Distance(fitter, self.bootstrap, self.most)
        (self.given,) = fitter.fit([Start(NONE, np.zeros((1, 0)))])

    def explains(self, fit: Fit) -> bool:
        """Return whether a fit leaves nothing; see `Left`."""
        return self.left(fit).is_nothing(self.settings)

    def is_enough(self, fit: Fit) -> bool:
        """Return whether a fit explains the gap and shortens errors by what that takes."""
        return self.explains(fit) and self.left(fit).closes >= self.settings.most

    def left(self, fit: Fit) -> Left:
        """Return what a fit leaves."""
        if fit not in self._lefts:
            self._lefts[fit] = self._measure_left(fit)
        return self._lefts[fit]

    def _measure_left(self, fit: Fit) -> Left:
        replayer, windows = self.replayer, self.left_in_windows(fit)
        readings = self.rows * len(self.most)
        lasting = np.argsort(np.argsort(-windows)) >= int(self.settings.moments * len(windows))
        gain = self.bootstrap.gain(np.where(lasting, windows, 0.0))
        held = (one.held[lasting] / replayer.noise for one in (self.given, fit))
        before, after = (np.sqrt(np.square(errors).sum()) for errors in held)
        least = np.sqrt(replayer.used[lasting].sum() * len(self.most))  # noise alone
        closes = min(float((before - after) / max(before - least, TINY)), 1.0)
        whole = self.bootstrap.gain(windows).high / readings
        worst = total = Gain(*(value / readings for value in gain))
        if total.high <= self.settings.equivalence_tolerance:  # every joint is asked if all pass
            own = np.eye(len(self.most)) > 0
            ranges = [(0.0, size) for size in np.where(own, self.most, np.inf)]
            for score in self.fitter.score_within(fit, ranges, near=True):
                gain = self.bootstrap.gain(np.where(lasting, fit.score - score, 0.0))
                one = Gain(*(value / self.rows for value in gain))
                worst = max(worst, one, key=lambda gain: gain.high)
        usual = all(map(self.fitter.likelihood.is_usual, fit.trained))
        return Left(total, worst, whole, closes, usual)

    def left_in_windows(self, fit: Fit) -> np.ndarray:
        """Return what a free discrepancy gains in each window [nats], (W,)."""
        return fit.score - self.fitter.score_within(fit, [(0.0, self.most)])[0]

    def find_open(self, fit: Fit) -> list[str]:
        """Return the joints at which a fit's free discrepancy is larger than a count, or all."""
        likelihood = self.fitter.likelihood
        sizes = np.max([likelihood.sizes[trained.size] for trained in fit.trained], axis=0)
        joints = [joint.name for joint in self.replayer.data.joints]
        return [name for name, own in zip(joints, sizes > self.most, strict=True) if own] or joints

    def price(self, hypothesis: Hypothesis) -> float:
        """Return what a hypothesis has to win [nats a row]."""
        values, _ = hypothesis.burden
        return compute_price(len(hypothesis.members), values, self.choices, self.settings)

    def wins(self, more: Fit, less: Fit) -> bool:
        """Return whether further members win what they have to, for certain."""
        gain = self.bootstrap.gain(more.score - less.score)
        least = (self.price(more.hypothesis) - self.price(less.hypothesis)) * self.rows
        return gain.low > 0 and gain.total > least

    def choose(self, tried: dict[str, Fit]) -> Fit:
        """Return the shortest explanation that none longer wins against."""
        best = self.given
        for count in range(1, self.settings.members_max + 1):
            own = [fit for fit in tried.values() if len(fit.hypothesis.members) == count]
            if winners := [fit for fit in own if self.wins(fit, best)]:
                best = self._pick_simplest(winners)
        return best

    def _pick_simplest(self, fits: Sequence[Fit]) -> Fit:
        """Return the best, or one of fewer free values that is not significantly worse.

        A whole number, such as of rows or turns, is not free to follow anything. Then those without
        mistakes in the log go first: what is equivalent to an effect of the robot is called one.
        """
        top = max(fits, key=lambda fit: fit.total - self.price(fit.hypothesis) * self.rows)
        least = self.settings.settled  # nats, to which a fit is known
        near = [f for f in fits if self.bootstrap.gain(top.score - f.score).low <= least]
        return min(near, key=lambda f: (*f.hypothesis.burden, -f.total))
