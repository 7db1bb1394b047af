"""Quicker looks at the windows: in longer time steps, and at some of them, for what is only tried.

quick = Quick(fitter, given, coarse)        # all windows
glance = Glance(fitter, given, local, common)
glance.anchor(best)                         # what longer steps change is what they change of it
"""

import math

import numpy as np

from sim2real.diagnosis.inference.fit import Fit, Fitter
from sim2real.diagnosis.inference.likelihood import Likelihood
from sim2real.diagnosis.inference.replayer import Replayer
from sim2real.diagnosis.inference.score import FOLDS
from sim2real.diagnosis.inference.unknowns import coarsen

HALVES = 2  # half of the windows at most
LEAST = 3  # windows of a fold that changes are screened on


class Quick(Fitter):
    """What fits in longer time steps: all windows, or those `chosen`, (n,), by their likelihood.

    What longer steps change of the model as given is taken off all errors. The fitter takes the
    model's own steps; `coarse` replays the windows that are looked at.
    """

    def __init__(
        self,
        fitter: Fitter,
        given: Fit,
        coarse: Replayer,
        chosen: np.ndarray | None = None,
        likelihood: Likelihood | None = None,
    ) -> None:
        self.chosen = fitter.replayer.every if chosen is None else chosen
        own = fitter.likelihood if likelihood is None else likelihood
        super().__init__(coarse, own, fitter.fold[self.chosen])
        self.anchor(given)

    def anchor(self, fit: Fit) -> None:
        """Take off all errors what longer steps change of a fit of all windows."""
        values = fit.values[self.fold]
        self.replayer.anchor(fit.hypothesis, values, fit.own[self.chosen])


class Glance(Quick):
    """What changes are screened with: some windows of each fold, in longer time steps.

    Half of them are those with most `left` to explain, (W,) nats, the others lie evenly over the
    rest. For `local` and `common`, of all windows, see `Likelihood`.
    """

    def __init__(
        self,
        fitter: Fitter,
        given: Fit,
        left: np.ndarray,
        local: np.ndarray,
        common: np.ndarray,
    ) -> None:
        every, settings = fitter.replayer, fitter.settings
        seconds = float(np.mean([np.ptp(own) for own in every.times]))  # of a window
        wanted = max(LEAST, math.ceil(settings.glance_s / FOLDS / seconds))
        counts = [min(wanted, max(LEAST, len(own) // HALVES), len(own)) for own in fitter.sides]
        pairs = zip(fitter.sides, counts, strict=True)
        chosen = np.sort(np.concatenate([_pick(own, left[own], n) for own, n in pairs]))
        likelihood = _make_likelihood(fitter, chosen, local, common)
        coarse = coarsen(every, given.own, chosen)
        super().__init__(fitter, given, coarse, chosen, likelihood)

    def renew(self, fitter: Fitter, local: np.ndarray, common: np.ndarray) -> None:
        """Judge by other unknowns from now on; see `Glance`."""
        self.likelihood = _make_likelihood(fitter, self.chosen, local, common)


def _make_likelihood(
    fitter: Fitter, chosen: np.ndarray, local: np.ndarray, common: np.ndarray
) -> Likelihood:
    """Return the likelihood of some windows (n,)."""
    every, basis = fitter.replayer, fitter.likelihood.basis.part(chosen)
    rows = every.times[chosen], every.used[chosen], every.noise
    return Likelihood(*rows, local[chosen], common[chosen], fitter.settings, basis)


def _pick(windows: np.ndarray, left: np.ndarray, count: int) -> np.ndarray:
    """Return so many of some windows, (n,): half of them with most left, (n,), and others."""
    most = windows[np.argsort(-left)[: count // HALVES]]
    rest = np.setdiff1d(windows, most)
    places = np.linspace(0, len(rest) - 1, count - len(most)).round().astype(int)
    return np.concatenate([most, rest[places]])
