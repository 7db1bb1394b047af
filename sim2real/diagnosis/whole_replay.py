"""Whole recordings, replayed from their first rows: how far off they are, and whether loops hunt.

    found = replayed(found, prepared)        # report.replay; findings; the verdict

A model that runs off has no replay, and what it says of hunting is left out.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

from envs.plant import Fixed
from sim2real.diagnosis.data.replay import Gap, measure_all, summary
from sim2real.diagnosis.outcome import Diagnosis
from sim2real.diagnosis.preflight.hunting import tell_simulated
from sim2real.diagnosis.prepare import PreparedLogs
from sim2real.diagnosis.schema import Verdict, WholeReplay
from sim2real.diagnosis.settings import DEFAULT, Settings
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)
LESS: Mapping[Verdict, Verdict] = {"explained": "partly_explained", "no_gap": "unexplained"}


def replayed(found: Diagnosis, prepared: PreparedLogs, settings: Settings = DEFAULT) -> Diagnosis:
    """Add what `run=replay` says of the logs, with what was known and with what was found.

    Where the robot hunts and the model does nowhere, with all that was found in it, nothing is
    explained, and there is a gap.
    """
    driven, models = prepared.driven, [("As given", _gaps(prepared, found.known))]
    if found.report.effects:
        models.append(("with the causes", _gaps(prepared, found.effects)))
    rmse = [float(summary(gaps)["rmse"]) if gaps else None for _, gaps in models]
    replay = WholeReplay(rmse[0], rmse[1] if len(rmse) > 1 else None)
    report, run = found.report, [(name, gaps) for name, gaps in models if gaps]
    checked, alone = tell_simulated(report.preflight, driven, run, settings)
    less = alone and models[-1][1]
    verdict = LESS.get(report.verdict, report.verdict) if less else report.verdict
    report = replace(report, replay=replay, preflight=tuple(checked), verdict=verdict)
    return found._replace(report=report)


def _gaps(prepared: PreparedLogs, effects: Sequence[Fixed]) -> list[Gap]:
    """Return all logs replayed with effects; none where the model runs off."""
    try:
        return measure_all(prepared.logs, prepared.specs, effects)
    except Sim2RealError as error:
        log_.info("no whole replay: %s", error)
        return []
