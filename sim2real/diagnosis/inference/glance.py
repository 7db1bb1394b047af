"""A quicker look at the windows: some of them, in longer time steps, for what is only tried.

glance = make_glance(fitter, given, local, common)
"""

from __future__ import annotations

import math

import numpy as np

from sim2real.diagnosis.inference.fit import Fitter
from sim2real.diagnosis.inference.hypotheses import Hypothesis
from sim2real.diagnosis.inference.likelihood import Likelihood
from sim2real.diagnosis.inference.replayer import Job
from sim2real.diagnosis.inference.unknowns import is_lost

NONE = Hypothesis(())
HALVES = 2  # every second window at most
LEAST = 3  # windows of a fold that changes are screened on


def make_glance(fitter: Fitter, given: np.ndarray, local: np.ndarray, common: np.ndarray) -> Fitter:
    """Return what changes are screened with: some windows of each fold, in longer time steps.

    What longer steps change of the model as given is taken off all errors; where it is lost, they
    would change everything. What adds a spring is stepped as the model is.

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
    longer = None if is_lost(every, given) else every.data.stepping(settings.coarse_s)
    replayer = every.part(chosen)
    if longer is not None:
        finer, replayer = replayer, every.part(chosen, longer)
        (coarse,) = replayer.replay([Job(NONE, np.zeros((len(chosen), 0)), replayer.every)])
        replayer.offset, replayer.finer = given[chosen] - coarse.error, finer
    rows = replayer.times, replayer.used, replayer.noise
    basis = fitter.likelihood.basis.part(chosen)
    likelihood = Likelihood(*rows, local[chosen], common[chosen], settings, basis)
    return Fitter(replayer, likelihood, fitter.fold[chosen])
