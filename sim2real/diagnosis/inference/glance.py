"""A quicker look at the windows: some of them, in longer time steps, for what is only tried.

glance = make_glance(fitter, given, local, common)
"""

import math

import numpy as np

from sim2real.diagnosis.inference.fit import Fitter
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.likelihood import Likelihood
from sim2real.diagnosis.inference.replayer import Job, Replayer
from sim2real.diagnosis.inference.unknowns import is_lost

NONE = Hypothesis(())
HALVES = 2  # every second window at most
SPRINGS = 2  # times shorter steps of models with springs or play
LEAST = 3  # windows of a fold that changes are screened on


def make_glance(fitter: Fitter, given: np.ndarray, local: np.ndarray, common: np.ndarray) -> Fitter:
    """Return what changes are screened with: some windows of each fold, in longer time steps.

    What longer steps change of the model as given is taken off all errors; where it is lost, they
    would change everything. What adds a spring or play takes shorter steps.

    Args:
        fitter: of all windows.
        given: errors of the model as given, (W, N, M).
        local: see `Likelihood`.
        common: see `Likelihood`.
    """
    every, settings = fitter.replayer, fitter.settings
    seconds = sum(float(np.ptp(own)) for own in every.times)
    often = max(HALVES, math.ceil(seconds / settings.glance_s))
    steps = [max(1, min(often, len(own) // LEAST)) for own in fitter.sides]
    some = [own[::step] for own, step in zip(fitter.sides, steps, strict=True)]
    chosen = np.sort(np.concatenate(some))
    replayer = every.part(chosen)
    if not is_lost(every, given):
        replayer = _stepping(every, chosen, given, settings.coarse_s)
        replayer.finer = _stepping(every, chosen, given, settings.coarse_s / SPRINGS)
    rows = replayer.times, replayer.used, replayer.noise
    basis = fitter.likelihood.basis.part(chosen)
    likelihood = Likelihood(*rows, local[chosen], common[chosen], settings, basis)
    return Fitter(replayer, likelihood, fitter.fold[chosen])


def _stepping(every: Replayer, chosen: np.ndarray, given: np.ndarray, most: float) -> Replayer:
    """Return a replayer of some windows, (n,), in steps of at most so long [s], or as they are."""
    longer = every.data.stepping(most)
    if longer is None:
        return every.part(chosen)
    replayer = every.part(chosen, longer)
    (coarse,) = replayer.replay([Job(NONE, np.zeros((len(chosen), 0)), replayer.every)])
    replayer.offset = given[chosen] - coarse.error
    return replayer
