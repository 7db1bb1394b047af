"""Every candidate alone, for the table of a report: what was fitted, then what was only screened.

rows = singles(search, found, causes)
rows[0].closed, rows[0].ci                   # a share and its interval; None for an estimate
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sim2real.diagnosis.attribution.attribute import Found, Search
from sim2real.diagnosis.attribution.candidates import FREE, Candidate
from sim2real.diagnosis.evidence import SingleFit
from sim2real.diagnosis.settings import TINY_SQUARE


def singles(search: Search, found: Found, causes: Sequence[Candidate]) -> tuple[SingleFit, ...]:
    """Return every candidate alone: fitted where it was, else as screening predicts.

    Args:
        search: after its run.
        found: what it returned.
        causes: the causes, in the report's order.
    """
    fitted = {c.candidate.label: c for c in found.singles}
    order = [cause.label for cause in causes]
    rows = []
    for guess in found.guesses:
        option = guess.candidate
        contender = fitted.get(option.label)
        if contender is not None:
            closed, ci = search.blocks.closed(search.base, contender.error, search.floor)
            value = float(contender.fit.mean[0])
        else:
            closed = (1 - np.sqrt(max(1 - guess.gain, 0.0))) if guess.gain > 0 else 0.0
            closed = float(closed * search.before / max(search.before - search.floor, TINY_SQUARE))
            ci, value = None, float(guess.start[0])
        row = SingleFit(
            option.name,
            option.place,
            option.effect.side,
            min(value, FREE),
            option.effect.unit,
            min(closed, 1.0),
            ci,
        )
        place = order.index(option.label) if option.label in order else len(order)
        rows.append(((ci is None, place, -row.closed), row))
    return tuple(row for _, row in sorted(rows, key=lambda pair: pair[0]))
