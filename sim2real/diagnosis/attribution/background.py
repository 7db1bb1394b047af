"""How far the small errors that any model has may have moved the values of a fit.

    beside = shifts(search, fit)                    # (P,) standard deviations

Masses come from a scale, friction and gains from a data sheet: all are a few per cent off
(`usual`). A fit of one cause bends its values until they mend a part of that, which blocks that are
drawn again cannot tell, since the errors are the same in all of them. So the usual errors are taken
as random factors of one spread, which is told from what the fit leaves: they have to make that, and
the part of them that looks like the fitted effects was swallowed by these. A fit that leaves the
noise alone has no such doubt.

With residual r, sensitivities J of the values and U of the factors, and A = (J'J)^-1 J':
spread^2 = (|r|^2 - |noise|^2) / |U - J A U|^2, of the values spread * |A U|, row by row. These are
the moments of a linear model with a random discrepancy (Kennedy and O'Hagan, 2001).
"""

from __future__ import annotations

import numpy as np

from sim2real.diagnosis.attribution.attribute import Search
from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.fit import FOLDS, Ask, Fit, sensitivities
from sim2real.diagnosis.attribution.problem import Problem
from sim2real.diagnosis.attribution.quantify import solved
from sim2real.diagnosis.attribution.usual import scaled
from sim2real.diagnosis.settings import TINY_SQUARE


def shifts(search: Search, fit: Fit) -> np.ndarray:
    """Return the standard deviation of each value that usual errors make, (P,), in its own unit.

    Looked at on the windows of a race. Of a fit that leaves the noise no error is simulated.

    Args:
        search: after its run.
        fit: the causes.
    """
    nothing = np.zeros(fit.values.shape[1])
    problem = search.problem.subset(search.racing.windows)
    error, slope = (part[0] for part in problem.errors(fit.members, fit.values[None]))
    shift = problem.shift(error, slope)[problem.fold]
    left = (error + shift[:, None, None] * slope).ravel()
    excess = float(left @ left) - search.floor**2 * problem.rows
    if excess <= 0:
        return nothing
    limits = problem.data.settings.causes
    own = sensitivities(problem, fit.members, fit.values, error).reshape(len(nothing), -1)
    usual = _changes(problem, fit, error, limits.usual_error)
    if not len(usual):
        return nothing
    mends = solved(own @ own.T, own @ usual.T, limits)  # (P, K)
    seen = usual - mends.T @ own
    spread = min(excess / max(float((seen**2).sum()), TINY_SQUARE), 1.0) ** 0.5
    return spread * np.sqrt((mends**2).sum(axis=1))


def _changes(problem: Problem, fit: Fit, error: np.ndarray, size: float) -> np.ndarray:
    """Return what usual errors of full size change beside a fit, (K, rows)."""
    taken = {(m.name, m.effect.where) for m in fit.members}
    members = [o for o in scaled(problem.data) if (o.name, o.effect.where) not in taken]
    asks = [Ask((*fit.members, one), _raised(fit, one, size)) for one in members]
    return np.array([(moved[0] - error).ravel() for moved, _ in problem.errors_each(asks)])


def _raised(fit: Fit, one: Candidate, size: float) -> np.ndarray:
    """Return the values of a fit with one factor raised, (1, 2, P + 1)."""
    raised = np.full((FOLDS, len(one.neutral)), 1 + size)
    return np.concatenate([fit.values, raised], axis=1)[None]
