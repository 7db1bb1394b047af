"""Which unmodelled effect separates a robot's logs from its simulation.

On the command line it is `python -m sim2real run=diagnose log=swing.csv model=arm.xml`, and in
Python

    report = diagnose("logs/", "arm.xml", exclude=["backlash"])
    report.verdict, [(cause.effect, cause.where, cause.value) for cause in report.causes]

The run's folder gets `report.json`, `report.html`, `effects.yaml` and `model.xml`; any of them is
whole or absent.
"""

from __future__ import annotations

import datetime
import hashlib
import logging
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from importlib import metadata
from pathlib import Path

import mujoco
import numpy as np

from envs.effects import combined, load_effects
from envs.replay import without_impedance
from hardware.log import Log, read_logs
from sim2real.diagnosis.attribution.apart import Member
from sim2real.diagnosis.attribution.attributed import About, attributed, causes_of
from sim2real.diagnosis.attribution.candidates import check_names
from sim2real.diagnosis.attribution.conclude import Conclusion
from sim2real.diagnosis.attribution.fit import columns
from sim2real.diagnosis.attribution.grip import check_grip
from sim2real.diagnosis.attribution.numerics import NullTest, is_numerics, null_test
from sim2real.diagnosis.attribution.ties import witnesses
from sim2real.diagnosis.closed_loop.check import Drawn, LoadPlayer, closed_loop_of
from sim2real.diagnosis.contract.logged import LoadPolicy, check_beforehand
from sim2real.diagnosis.data.channels import channel_gaps, contradicting
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.kinds import refuse_kinds
from sim2real.diagnosis.data.progress import Moving, Progress
from sim2real.diagnosis.data.recording import load_model
from sim2real.diagnosis.data.starts import with_free_starts
from sim2real.diagnosis.data.work import Work
from sim2real.diagnosis.design import design
from sim2real.diagnosis.evidence import Evidence
from sim2real.diagnosis.ground.findings import check_ground
from sim2real.diagnosis.ground.logs import estimate_all
from sim2real.diagnosis.ground.pushes import check_pushes
from sim2real.diagnosis.ground.windows import grounded
from sim2real.diagnosis.outcome import Diagnosis, blocking, intervals_of
from sim2real.diagnosis.preflight.checks import UNITS, preflight
from sim2real.diagnosis.preflight.hunting import mark_hunting
from sim2real.diagnosis.preflight.obstruction import mark_blocked, positioned
from sim2real.diagnosis.preflight.torques import measured_torques
from sim2real.diagnosis.report.traces import signals, traces
from sim2real.diagnosis.schema import Finding, Report
from sim2real.diagnosis.settings import DEFAULT, Settings, rows
from sim2real.diagnosis.whole import replayed
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)
TELLING = 0.95  # share of the work that is done then


Step = Callable[[Diagnosis], Diagnosis]


def diagnose(
    logs: str | Path | Log | Iterable[str | Path | Log],
    model: str | Path | None = None,
    *,
    effects: str | Path | None = None,
    exclude: Sequence[str] = (),
    seed: int = 0,
    progress: Progress | None = None,
    settings: Settings = DEFAULT,
    load_policy: LoadPolicy | None = None,
    load_player: LoadPlayer | None = None,
    actor: str | Path | None = None,
) -> Report:
    """Locate a gap, name what causes it, and say how much is left once it is added.

    Args:
        logs: a log, a folder of logs, or a list of these or of logs in memory.
        model: an MJCF for all logs; None takes the one that each log names.
        effects: an effects.yaml of what is known already; put into the model first.
        exclude: names of effects that are left out of the candidates.
        seed: the seed of the bootstrap.
        progress: called with what is being tried and the share of the work that is done.
        settings: every number that steers the answer, by stage.
        load_policy: reads the policy that a log names, such as
            `sim2real.deployment.actors.load_actor`, so that its actions are compared; None checks
            the rest of its interface.
        load_player: makes that policy play in its simulator, such as
            `sim2real.loops.player.load_player`; None leaves the closed loop out.
        actor: the policy that wrote the logs; None for the one that they name, if any.

    Returns:
        The report; `report.evidence` holds what its pictures show.

    Raises:
        Sim2RealError: no model, an unknown effect to exclude, joints that never moved, a log
            too short, a model that diverges.
        LogError: a log that is damaged, or names what the model lacks.
        EffectError: an effects file that is wrong, or an effect that the robot cannot have.
    """
    return run_diagnosis(
        _read(logs),
        model,
        effects,
        exclude,
        seed,
        progress,
        settings,
        load_policy=load_policy,
        load_player=load_player,
        actor=actor,
    ).report


def run_diagnosis(
    logs: Sequence[Log],
    model: str | Path | None,
    effects: str | Path | None,
    exclude: Sequence[str],
    seed: int,
    progress: Progress | None,
    settings: Settings = DEFAULT,
    on_verdict: Callable[[Diagnosis], None] | None = None,
    load_policy: LoadPolicy | None = None,
    load_player: LoadPlayer | None = None,
    actor: str | Path | None = None,
) -> Diagnosis:
    """Diagnose; the other arguments are those of `diagnose`, logs in memory.

    `on_verdict` is called as soon as there is a verdict, with all but what takes long to add
    (pictures of recordings, the next experiment). A step after that which fails is a line in the
    report, under `failed`.
    """
    start, on_progress = time.monotonic(), Moving(progress or (lambda text, share: None))
    check_names(exclude)
    if not logs:
        raise Sim2RealError("there are no logs to diagnose; give at least one")
    fixed = [] if effects is None else load_effects(effects)
    rng = np.random.default_rng(seed)
    on_progress("looking at the logs", 0.0)
    played = logs
    driven = _driven(logs, model)
    logs, held = mark_blocked(logs, driven, settings.obstruction)
    logs, hunts = mark_hunting(logs, driven, settings.hunting)
    estimates = estimate_all(logs, model, settings.ground)
    logs = [one.log for one in estimates] or logs
    given = data = Data.of(logs, model, settings)
    if estimates:
        on_progress("estimating where the base was", 0.0)
        data = grounded(given, estimates, fixed)
    else:
        data = with_free_starts(given, fixed)
    specs = [data.specs[_model_of(data, number)] for number in range(len(logs))]
    for log, spec in zip(logs, specs, strict=True):
        refuse_kinds(log, spec, settings.kinds)
    interface = check_beforehand(logs, load_policy, settings, actor)
    findings = [*interface.findings, *held, *hunts, *preflight(logs, specs, settings)]
    models = [data.models[_model_of(data, number)] for number in range(len(logs))]
    findings += check_ground(estimates, models, settings.ground)
    findings += check_pushes(data, estimates, settings.ground)
    wrong = [finding.finding for finding in findings if finding.check in UNITS]
    about = About(data, exclude, fixed, rng, on_progress, Work(), witnesses(findings, fixed))
    restart = partial(grounded, given, estimates) if estimates else None
    found = attributed(about, wrong[0] if wrong else None, restart)
    if estimates:
        search = found.search
        findings += check_grip(search.problem, search.options, search.floor)
    data, _, floors, made = found
    null = null_test(logs, specs, fixed, settings.numerics)
    on_progress("telling what was found", TELLING)
    evidence = Evidence(
        (),
        made.ladder,
        made.singles,
        made.bands,
        settings=tuple(rows(data.settings)),
        correlations=made.correlations,
    )
    inputs = _inputs(data, model, seed, exclude)
    inputs["physics steps"] = dict(about.work.steps.most_common())
    if interface.verdict is not None:
        inputs["policy's interface"] = interface.verdict.replace("_", " ")
    report = replace(
        made.report,
        preflight=(*findings, *made.report.preflight),
        numerics=dict(null.words) or {"timestep": "ok"},
        seconds=time.monotonic() - start,
        failed=(*interface.failed, *made.report.failed),
        evidence=replace(evidence, inputs=inputs),
    )
    plain = without_impedance(data.specs[0])
    told = Diagnosis(
        report,
        causes_of(made.fit),
        plain,
        _intervals(made),
        tuple(fixed),
        tuple(Member(label, causes_of(fit)) for label, fit in made.alike),
        {joint.name: float(f) for joint, f in zip(data.joints, floors, strict=True)},
    )
    whole = partial(replayed, logs=logs, specs=specs, driven=driven, settings=settings.hunting)
    told = _added(told, "the replay of whole recordings", whole)
    if on_verdict is not None:
        on_verdict(told)
    steps: dict[str, Step] = {
        "the causes' test for numerics": lambda d: _tested(d, logs, specs, null, settings),
        "the pictures of recordings": lambda d: _pictured(d, made, data, floors),
        "the other channels": lambda d: _witnessed(d, data),
        "the closed loop": lambda d: _played(d, played, load_player, actor, seed, settings),
        "the next experiment": lambda d: _planned(d, data, seed),
    }
    for name, step in steps.items():
        told = _added(told, name, step)
    on_progress("done", 1.0)
    return told._replace(report=replace(told.report, seconds=time.monotonic() - start))


def _added(found: Diagnosis, name: str, step: Step) -> Diagnosis:
    """Return a diagnosis with what a step adds; a step that fails is a line in the report."""
    try:
        return step(found)
    except Exception as error:
        log_.exception("%s failed", name)
        failed = (*found.report.failed, f"{name}: {error}")
        return found._replace(report=replace(found.report, failed=failed))


def _tested(
    found: Diagnosis,
    logs: Sequence[Log],
    specs: Sequence[mujoco.MjSpec],
    null: NullTest,
    settings: Settings,
) -> Diagnosis:
    """Say which causes are the simulator's numerics; these are left out of the files."""
    words, physical = dict(found.report.numerics), []
    for number, (cause, told) in enumerate(zip(found.found, found.report.values, strict=True)):
        artefact = is_numerics(logs, specs, [cause], null, found.known, settings.numerics)
        if artefact is None:
            physical.append(number)
        else:
            words[f"{told.effect} at {told.where or 'the robot'}"] = artefact
    return found._replace(
        report=replace(found.report, numerics=words),
        found=tuple(found.found[i] for i in physical),
        intervals=tuple(found.intervals[i] for i in physical),
    )


def _pictured(found: Diagnosis, made: Conclusion, data: Data, floors: np.ndarray) -> Diagnosis:
    models = [data.models[_model_of(data, number)] for number in range(len(data.logs))]
    pictures = traces(data, made.errors, floors)
    evidence = replace(found.report.evidence, traces=pictures, signals=signals(data.logs, models))
    return found._replace(report=replace(found.report, evidence=evidence))


def _witnessed(found: Diagnosis, data: Data) -> Diagnosis:
    """Add how far the channels that nothing was fitted to are off, and which speak against it."""
    pairs = [(log, data.models[_model_of(data, k)]) for k, log in enumerate(data.logs)]
    torque = measured_torques(pairs, data.settings.servo)
    every = combined(found.known, found.found) if found.found else found.known
    gaps = channel_gaps(data, found.known, every, torque)
    against = [Finding(*words) for words in contradicting(gaps, data.settings.channels)]
    report, evidence = found.report, replace(found.report.evidence, channels=gaps)
    report = replace(report, preflight=(*report.preflight, *against), evidence=evidence)
    return found._replace(report=report)


def _played(
    found: Diagnosis,
    logs: Sequence[Log],
    load_player: LoadPlayer | None,
    actor: str | Path | None,
    seed: int,
    settings: Settings,
) -> Diagnosis:
    """Add how the policy that wrote the logs fares in both simulators."""
    if blocking(found.report):
        return found
    effects = combined(found.known, found.found)
    drawn = [Drawn(*one, ci) for one, ci in zip(effects, intervals_of(found), strict=True)]
    loop = closed_loop_of(logs, load_player, actor, drawn, seed, settings.closed_loop)
    return found._replace(report=replace(found.report, closed_loop=loop))


def _planned(found: Diagnosis, data: Data, seed: int) -> Diagnosis:
    """Add what to record to separate effects that explain the logs alike, where some do."""
    if not found.alike:
        return found
    logs = [log for number, log in enumerate(data.logs) if _model_of(data, number) == 0]
    rng, limits = np.random.default_rng(seed), data.settings.experiment
    try:
        plan = design(found, logs, data.specs[0], rng=rng, settings=limits)
    except Sim2RealError as error:
        log_.info("no next experiment: %s", error)
        return found
    return found._replace(report=replace(found.report, next_experiment=plan.text))


def _read(logs: str | Path | Log | Iterable[str | Path | Log]) -> list[Log]:
    if isinstance(logs, str | Path):
        return read_logs(logs)
    if isinstance(logs, Log):
        return [logs]
    found: list[Log] = []
    for one in logs:
        found += [one] if isinstance(one, Log) else read_logs(one)
    return found or read_logs([])


def _driven(logs: Sequence[Log], model: str | Path | None) -> dict[str, str]:
    """Return the joint that each actuator drives by desired positions, of all models."""
    return {k: v for log in logs for k, v in positioned(log, load_model(log, model)).items()}


def _model_of(data: Data, number: int) -> int:
    return next((w.model for w in data.windows if w.log == number), 0)


def _intervals(made: Conclusion) -> tuple[tuple[float, float], ...]:
    """Return the interval of each cause's first value."""
    starts = [place.start for place in columns(made.fit.members)]
    return tuple((float(low), float(high)) for low, high in made.intervals[starts])


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _inputs(
    data: Data, model: str | Path | None, seed: int, exclude: Sequence[str]
) -> dict[str, object]:
    paths = [str(log.path) for log in data.logs if log.path]
    own = [str(log.model) for log in data.logs if log.model]
    fold = [int(f) for f in data.fold]
    return {
        "logs": paths,
        "models": sorted({str(model)} if model else set(own)),
        "seed": seed,
        "exclude": list(exclude),
        "made": datetime.datetime.now().astimezone().isoformat(" ", "minutes"),
        "versions": {"sim2real": metadata.version("sim2real"), "mujoco": mujoco.__version__},
        "robots": sorted({str(log.meta["robot"]) for log in data.logs if log.meta.get("robot")}),
        "sha256": {path: _sha256(Path(path)) for path in paths if Path(path).is_file()},
        "windows": len(fold),
        "folds": _folds(data),
    }


def _folds(data: Data) -> str:
    """Return how windows were dealt, and what the two folds have in common."""
    fold = [int(f) for f in data.fold]
    text = f"{fold.count(0)} and {fold.count(1)} windows, each judged by the other's fit"
    episodes = [
        {(w.log, w.episode) for w, f in zip(data.windows, fold, strict=True) if f == side}
        for side in (0, 1)
    ]
    if episodes[0].isdisjoint(episodes[1]):
        return text
    least = data.settings.dataset.whole_episodes_min
    return (
        f"{text}; both are from the same episodes, fewer than {least}, so that what changes from "
        "one recording to the next (heat, mounting) widens no interval"
    )
