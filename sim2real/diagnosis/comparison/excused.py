"""What is put down to temperature, mounting and supply, simulated rather than drawn as a line.

    pieces, moved = excuse(first, made, (before, after), confounders(made, before, after, True))

A tenth less friction in all joints moves a robot by more than a few per cent of it in one, and its
straight line is wrong by as much as what is looked for. So the side after is simulated once more
with what was put down to other things, and only what that leaves is explained by straight lines.
"""

from collections.abc import Collection

import numpy as np

from sim2real.diagnosis.comparison.confounders import Confounded
from sim2real.diagnosis.comparison.permuted import Prior, explain
from sim2real.diagnosis.comparison.pieces import Pieces, contrasts
from sim2real.diagnosis.comparison.prepared import Prepared
from sim2real.diagnosis.comparison.response import errors

WORSE = 0.1  # of the squares: clocks take some of what a change mends, and are not in them
ROUNDS = 2  # the second mends what a straight line missed; a third changes no verdict


def excuse(
    first: Pieces, made: Prepared, sides: tuple[Collection[int], Collection[int]], found: Confounded
) -> tuple[Pieces, dict[int, float]]:
    """Return the pieces once the side after is simulated with what is put down to other things.

    Args:
        first: the pieces of the errors as they are.
        made: the replayed logs.
        sides: the logs before and those after.
        found: the columns that something else may have changed, and what is known of them.

    Returns:
        The pieces that are left, and what was simulated of each column.
    """
    columns, response, prior = list(found.aside), made.response, found.prior
    best, moved = first, dict.fromkeys(columns, 0.0)
    later = np.array([i for i, w in enumerate(made.data.windows) if w.log in sides[1]], int)
    spread, reach, middle = prior.spread.copy(), found.reach[columns], prior.mean[columns]
    spread[columns] = np.minimum(spread[columns], [response.columns[k].typical for k in columns])
    for _ in range(ROUNDS if columns else 0):
        left = Prior(prior.after(moved).mean, spread)
        more = explain(best, [*columns, *best.clocks], left)[: len(columns)]
        whole = np.clip(list(moved.values()) + more, middle - reach, middle + reach)
        tried = dict(zip(columns, whole.tolist(), strict=True))
        error = made.error.copy()
        error[later] = errors(made.simulator, response.moved(made.watch, tried), later)
        pieces = contrasts(made, error, *sides)
        if np.sum(pieces.rms**2) > (1 + WORSE) * np.sum(best.rms**2):
            break
        best, moved = pieces, tried
    return best, moved
