"""From held-out errors to a verdict, for the same causes in one simulation or another.

judge = Judge(search, fit.members, floors, form=True)
verdict_of(judge.rest(search.base, found.error), search.problem.data)
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim2real.diagnosis.attribution.attribute import Search
from sim2real.diagnosis.attribution.candidates import Candidate
from sim2real.diagnosis.attribution.verdict import (
    Rest,
    crowd_of,
    imitations,
    is_open,
    is_resolved,
    stands_out,
    unwitnessed,
)


class Judge(NamedTuple):
    """Who says what causes come to.

    Args:
        search: after its run.
        members: the causes.
        floors: noise floor of each joint [rad or m], (M,).
        form: whether their laws hold wherever they were tried.
    """

    search: Search
    members: tuple[Candidate, ...]
    floors: np.ndarray
    form: bool

    def rest(self, base: np.ndarray, error: np.ndarray) -> Rest:
        """Return what a verdict is told from.

        Args:
            base: held-out errors of the model as given, (W, T, M).
            error: with the causes.
        """
        data, blocks, floor = self.search.problem.data, self.search.blocks, self.search.floor
        closed, ci = blocks.closed(base, error, floor)
        alone = stands_out(base, data, self.floors), stands_out(error, data, self.floors)
        return Rest(
            blocks.rms(base),
            blocks.rms(error),
            floor,
            closed,
            ci[0],
            alone,
            is_open(error, data, self.floors),
            len(self.members),
            crowd_of(self.members),
            self.form,
            is_resolved(error, data),
            not unwitnessed(self.members, self.search.witnessed),
            not imitations(self.members),
        )
