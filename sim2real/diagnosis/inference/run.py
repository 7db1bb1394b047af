"""A diagnosis that the likelihood decides: a search proposes, the judge says.

found = run_judge(about)                   # found.made.report, found.floors
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from sim2real.diagnosis.attribution.attributed import About, Attributed, Restart, search_of
from sim2real.diagnosis.inference.conclusion import make_conclusion
from sim2real.diagnosis.inference.fit import Start
from sim2real.diagnosis.inference.judge import Judge
from sim2real.diagnosis.inference.log_changes import MOST, list_log_changes
from sim2real.diagnosis.inference.proposals import make_proposals
from sim2real.diagnosis.inference.replayer import skip_beginnings
from sim2real.diagnosis.inference.world_changes import list_world_changes

SEARCHED = 0.9  # share of the work that is done once a search has proposed


def run_judge(about: About, restart: Restart | None = None) -> Attributed:
    """Search, let the judge decide, and conclude.

    Args:
        about: what.
        restart: see `attributed`; where it is given, the log is taken as it is, since windows start
            from an estimate that was made of it.

    Raises:
        Sim2RealError: a model that cannot follow the logs.
    """
    floors = about.data.floors()
    search = search_of(about, floors)

    def say(text: str) -> None:
        search.say(text, SEARCHED)

    def propose() -> Sequence[Start]:
        return make_proposals(search, search.run())

    with about.work.during("judging"):
        known = about.data if restart else skip_beginnings(about.data, math.ceil(MOST))
        judge = Judge(known, about.fixed, about.rng, about.work, say)
        mistakes = list_log_changes(about.data) if restart is None else []
        judgement = judge.judge(propose, [*mistakes, *list_world_changes(about.data)])
        made = make_conclusion(judgement, search, floors, about.rng)
    data = replace(about.data, fold=judge.fold)  # with all rows: what pictures show
    return Attributed(data, search, floors, made)
