"""A quicker look at the windows: some of them, in longer time steps, for what is only tried.

glance = Glance(fitter, given, local, common)
glance.anchor(best)                         # what longer steps change is what they change of it
"""

import math

import numpy as np

from sim2real.diagnosis.inference.fit import Fit, Fitter
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.likelihood import Likelihood
from sim2real.diagnosis.inference.replayer import Replayer
from sim2real.diagnosis.inference.unknowns import is_lost

NONE = Hypothesis(())
HALVES = 2  # every second window at most
SPRINGS = 2  # times shorter steps of models with springs or play
LEAST = 3  # windows of a fold that changes are screened on


class Glance(Fitter):
    """What changes are screened with: some windows of each fold, in longer time steps.

    What longer steps change of the model as given is taken off all errors; where it is lost, they
    would change everything. What adds a spring or play takes shorter steps.

    Args:
        fitter: of all windows.
        given: errors of the model as given, (W, N, M).
        local: see `Likelihood`.
        common: see `Likelihood`.
    """

    def __init__(
        self, fitter: Fitter, given: np.ndarray, local: np.ndarray, common: np.ndarray
    ) -> None:
        every, settings = fitter.replayer, fitter.settings
        seconds = sum(float(np.ptp(own)) for own in every.times)
        often = max(HALVES, math.ceil(seconds / settings.glance_s))
        steps = [max(1, min(often, len(own) // LEAST)) for own in fitter.sides]
        some = [own[::step] for own, step in zip(fitter.sides, steps, strict=True)]
        self.chosen = np.sort(np.concatenate(some))
        self._coarse: list[Replayer] = []
        replayer = every.part(self.chosen)
        if not is_lost(every, given):
            replayer = _stepping(every, self.chosen, settings.coarse_s)
            replayer.finer = _stepping(every, self.chosen, settings.coarse_s / SPRINGS)
            self._coarse = [replayer, replayer.finer]
        rows = replayer.times, replayer.used, replayer.noise
        basis = fitter.likelihood.basis.part(self.chosen)
        directions = local[self.chosen], common[self.chosen]
        likelihood = Likelihood(*rows, *directions, settings, basis)
        super().__init__(replayer, likelihood, fitter.fold[self.chosen])
        self._take_off(NONE, np.zeros((len(self.chosen), 0)), given)

    def anchor(self, fit: Fit) -> None:
        """Take off all errors what longer steps change of a fit of all windows."""
        self._take_off(fit.hypothesis, fit.values[self.fold], fit.own)

    def _take_off(self, hypothesis: Hypothesis, values: np.ndarray, errors: np.ndarray) -> None:
        for replayer in self._coarse:
            replayer.anchor(hypothesis, values, errors[self.chosen])


def _stepping(every: Replayer, chosen: np.ndarray, most: float) -> Replayer:
    """Return a replayer of some windows, (n,), in steps of at most so long [s], or as they are."""
    return every.part(chosen, every.data.stepping(most))
