"""What is added to a verdict: replays, tests, pictures, channels, a closed loop, what to record.

    found = added(found, "the closed loop", lambda found: played(found, logs, ...))

A step that fails is a line in the report.
"""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from envs.plant import Fixed
from hardware.log import Log
from sim2real.diagnosis.closed_loop.check import Drawn, LoadPlayer, closed_loop_of
from sim2real.diagnosis.data.channels import channel_gaps, contradicting
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.replay import Gap, measure_all, summary
from sim2real.diagnosis.design import design
from sim2real.diagnosis.inference.conclusion import Conclusion
from sim2real.diagnosis.numerics import is_numerics
from sim2real.diagnosis.outcome import Diagnosis, blocking_findings, intervals_of
from sim2real.diagnosis.preflight.control_laws import measured_torques
from sim2real.diagnosis.preflight.hunting import tell_simulated
from sim2real.diagnosis.prepare import PreparedLogs
from sim2real.diagnosis.report.traces import signals, traces
from sim2real.diagnosis.schema import LOG_UNITS, Verdict, WholeReplay
from sim2real.diagnosis.settings import Settings
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)

LESS: Mapping[Verdict, Verdict] = {"explained": "partly_explained", "no_gap": "unexplained"}
Step = Callable[[Diagnosis], Diagnosis]


def added(found: Diagnosis, name: str, step: Step) -> Diagnosis:
    """Return a diagnosis with what a step adds; a step that fails is a line in the report."""
    try:
        return step(found)
    except Exception as error:
        log_.exception("%s failed", name)
        failed = (*found.report.failed, f"{name}: {error}")
        return found._replace(report=replace(found.report, failed=failed))


def replayed(found: Diagnosis, prepared: PreparedLogs, settings: Settings) -> Diagnosis:
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


def tested(found: Diagnosis, prepared: PreparedLogs, settings: Settings) -> Diagnosis:
    """Say which causes are the simulator's numerics; these are left out of the files."""
    words, physical = dict(found.report.numerics), []
    for number, (cause, effect) in enumerate(zip(found.found, found.report.effects, strict=True)):
        given = (found.report.numerics, found.known, settings)
        artefact = is_numerics(prepared.logs, prepared.specs, [cause], *given)
        if artefact is None:
            physical.append(number)
        else:
            words[f"{effect.effect} at {effect.where or 'the robot'}"] = artefact
    return found._replace(
        report=replace(found.report, numerics=words),
        found=tuple(found.found[i] for i in physical),
        intervals=tuple(found.intervals[i] for i in physical),
    )


def pictured(found: Diagnosis, made: Conclusion, data: Data, floors: np.ndarray) -> Diagnosis:
    """Add how measurement and simulation ran, with and without the causes.

    `floors` are the noise floors of the joints [rad or m], (M,).
    """
    pictures = traces(data, made.errors, floors)
    evidence = replace(
        found.report.evidence, traces=pictures, signals=signals(data.logs, data.log_models)
    )
    return in_log_units(found._replace(report=replace(found.report, evidence=evidence)))


def in_log_units(found: Diagnosis) -> Diagnosis:
    """Return the diagnosis with errors in LOG_UNITS where the log's unit is itself the mistake.

    Errors are of the readings as logged: degrees that were taken for rad stay degrees.
    """
    report = found.report
    wrong = {c.where for c in report.causes if c.effect == "unit" and "qpos" in c.extra["columns"]}
    if not wrong:
        return found
    traces = tuple(
        replace(trace, unit=LOG_UNITS) if wrong & {None, trace.joint} else trace
        for trace in report.evidence.traces
    )
    unit = "spread" if report.gap.unit == "spread" else LOG_UNITS  # a ratio is one in any unit
    evidence, gap = replace(report.evidence, traces=traces), replace(report.gap, unit=unit)
    return found._replace(report=replace(report, evidence=evidence, gap=gap))


def witnessed(found: Diagnosis, data: Data) -> Diagnosis:
    """Add how far the channels that nothing was fitted to are off, and which speak against it."""
    pairs = list(zip(data.logs, data.log_models, strict=True))
    torque = measured_torques(pairs, data.settings.preflight)
    gaps = channel_gaps(data, found.known, found.effects if found.found else None, torque)
    report, evidence = found.report, replace(found.report.evidence, channels=gaps)
    against = contradicting(gaps, data.settings.preflight)
    report = replace(report, preflight=(*report.preflight, *against), evidence=evidence)
    return found._replace(report=report)


def played(
    found: Diagnosis,
    logs: Sequence[Log],
    load_player: LoadPlayer | None,
    actor: str | Path | None,
    seed: int,
    settings: Settings,
) -> Diagnosis:
    """Add how the policy that wrote the logs fares in both simulators; see `diagnose`.

    The logs are as they were recorded. Nothing is played where they contradict themselves.
    """
    if blocking_findings(found.report):
        return found
    pairs = zip(found.effects, intervals_of(found), strict=True)
    drawn = [Drawn(*one, ci) for one, ci in pairs]
    loop = closed_loop_of(logs, load_player, actor, drawn, seed, settings)
    return found._replace(report=replace(found.report, closed_loop=loop))


def planned(found: Diagnosis, data: Data, seed: int) -> Diagnosis:
    """Add what to record to separate effects that explain the logs alike, where some do."""
    if not found.equivalents:
        return found
    logs = [log for log, index in zip(data.logs, data.which, strict=True) if index == 0]
    rng = np.random.default_rng(seed)
    try:
        plan = design(found, logs, data.specs[0], rng=rng, settings=data.settings)
    except Sim2RealError as error:
        log_.info("no next experiment: %s", error)
        return found
    return found._replace(report=replace(found.report, next_experiment=plan.text))
