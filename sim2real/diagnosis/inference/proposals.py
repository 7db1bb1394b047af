"""What the judge is asked to judge: what a search found, and what came near in it.

    starts = make_proposals(search, found)

A search of `attribution` proposes: every fit that raced is a hypothesis with a place to begin, and
so are its result, that result without each of its members, and what screening thought best of,
there and far beyond: a gain that is fifty times too high is no small change.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sim2real.diagnosis.attribution.attribute import Found, Search
from sim2real.diagnosis.attribution.fit import Fit, columns
from sim2real.diagnosis.attribution.quantify import without
from sim2real.diagnosis.inference.fit import Start
from sim2real.diagnosis.inference.hypotheses import Hypothesis

FAR = (6.0, 30.0)  # times what screening found best


def make_proposals(search: Search, found: Found) -> list[Start]:
    """Return hypotheses about the robot, each label once, and where they begin.

    Args:
        search: after its run.
        found: what it returned.
    """
    starts: dict[str, Start] = {}
    for fit in _fits(search, found):
        if not fit.members or len(fit.members) > search.problem.data.settings.inference.members_max:
            continue
        start = _start(fit)
        known = starts.get(start.hypothesis.label)
        if known is not None:
            start = Start(known.hypothesis, np.concatenate([known.points, start.points]))
        starts[start.hypothesis.label] = start
    for guess in search.first.guesses:
        hypothesis, candidate = Hypothesis((guess.candidate,)), guess.candidate
        points = [guess.start, *(candidate.towards(guess.start, scale) for scale in FAR)]
        known = starts.get(hypothesis.label)
        points += [] if known is None else list(known.points)
        starts[hypothesis.label] = Start(hypothesis, np.unique(points, axis=0))
    return list(starts.values())


def _fits(search: Search, found: Found) -> Iterator[Fit]:
    """Yield every fit that a search made of hypotheses, and each of their members alone."""
    yield found.fit
    for number in range(len(found.fit.members)):
        yield without(found.fit, [i for i in range(len(found.fit.members)) if i != number])
    crowds = [raced.contenders for raced in search.raced.values()]
    for contender in (
        one for crowd in [*crowds, found.singles, *found.rivals.values()] for one in crowd
    ):
        yield contender.fit
        for number in range(len(contender.fit.members)):
            yield without(contender.fit, [number])


def _start(fit: Fit) -> Start:
    """Return a fit as a start: from the values of each fold and from between."""
    order = sorted(range(len(fit.members)), key=lambda n: fit.members[n].label)
    members, places = [fit.members[n] for n in order], columns(fit.members)
    kept = np.concatenate([np.r_[places[n]] for n in order])
    points = np.concatenate([fit.values, fit.mean[None]])[:, kept]
    return Start(Hypothesis(tuple(members)), np.unique(points, axis=0))
