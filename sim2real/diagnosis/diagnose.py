"""Which unmodelled effect separates a robot's logs from its simulation.

On the command line it is `python -m sim2real run=diagnose log=swing.csv model=arm.xml`, and in
Python

    report = diagnose("logs/", "arm.xml", exclude=["backlash"])
    report.verdict, [(cause.effect, cause.where, cause.value) for cause in report.causes]

The run's folder gets `report.json`, `report.html`, `effects.yaml` and `model.xml`; any of them is
whole or absent.
"""

import datetime
import hashlib
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import mujoco
import numpy as np

from envs.effects import load_effects
from envs.replay import without_impedance
from hardware.log import Log, read_logs
from sim2real.diagnosis import additions
from sim2real.diagnosis.closed_loop.check import LoadPlayer
from sim2real.diagnosis.contract.logged import LoadPolicy, check_beforehand
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.progress import Moving, Progress
from sim2real.diagnosis.data.simulate import Work
from sim2real.diagnosis.evidence import Evidence
from sim2real.diagnosis.experiments.apart import Member
from sim2real.diagnosis.inference.candidates import check_names
from sim2real.diagnosis.inference.grip import check_grip
from sim2real.diagnosis.inference.run import About, find_causes
from sim2real.diagnosis.numerics import null_test
from sim2real.diagnosis.outcome import Diagnosis
from sim2real.diagnosis.prepare import prepare
from sim2real.diagnosis.report.provenance import links
from sim2real.diagnosis.schema import Report
from sim2real.diagnosis.settings import DEFAULT, Settings, rows
from sim2real.runs.errors import Sim2RealError

TELLING = 0.95  # share of the work that is done then


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
    """Find the causes of a gap and report how much of it they close.

    Args:
        logs: a log, a folder of logs, or a list of these or of logs in memory.
        model: an MJCF for all logs; None: the model that each log names.
        effects: an effects.yaml of known effects, which are put into the model first.
        exclude: names of effects that are not candidates.
        seed: the seed of the bootstrap.
        progress: receives the current step and the fraction of the work that is done.
        settings: every number that influences the answer, by stage.
        load_policy: loads the policy that a log names, such as
            `sim2real.deployment.actors.load_actor`, so that its actions are compared; None checks
            the rest of its interface.
        load_player: runs that policy in its simulator, such as
            `sim2real.loops.player.load_player`; None omits the closed loop.
        actor: the policy that ran during the recording; None: the one that the logs name.

    Returns:
        The report; `report.evidence` contains the data of its plots.

    Raises:
        Sim2RealError: there is no model, an excluded effect is unknown, no joint moved, a log
            is too short, or the model diverges.
        LogError: a log is damaged, or names something that the model lacks.
        EffectError: the effects file is wrong, or the robot cannot have an effect.
    """
    found, given = read_logs(logs), (model, effects, exclude, seed, progress, settings)
    return run_diagnosis(found, *given, None, load_policy, load_player, actor).report


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
    prepared = prepare(logs, model, fixed, settings, on_progress)
    interface = check_beforehand(prepared.logs, load_policy, settings, actor)
    findings = [*interface.findings, *prepared.findings]
    work = Work(on_progress.tick)
    about = About(prepared.data, exclude, fixed, rng, on_progress, work, prepared.restart)
    found = find_causes(about)
    made, data, floors = found.made, found.data, found.baseline.floors
    if prepared.restart is not None:
        findings += check_grip(found.judgement.judge.replayer, found.baseline.floor)
    numerics = null_test(prepared.logs, prepared.specs, fixed, settings)
    on_progress("telling what was found", TELLING)
    inputs = _inputs(data, found.judgement.judge.fold, model, seed, exclude)
    inputs["windows"] = f"{len(data.windows)} of {len(prepared.data.windows)}"
    inputs["physics steps"] = work.steps
    if interface.verdict is not None:
        inputs["policy's interface"] = interface.verdict.replace("_", " ")
    report = replace(
        made.report,
        preflight=(*findings, *made.report.preflight),
        numerics=numerics or {"timestep": "ok"},
        seconds=time.monotonic() - start,
        failed=(*interface.failed, *made.report.failed),
        evidence=Evidence(
            ladder=made.ladder,
            singles=made.singles,
            bands=made.bands,
            settings=tuple(rows(data.settings)),
            correlations=made.correlations,
            inputs=inputs,
        ),
    )
    outcome = Diagnosis(
        report,
        made.found,
        without_impedance(data.specs[0]),
        made.intervals,
        tuple(fixed),
        tuple(Member(*one) for one in made.alike),
        {joint.name: float(f) for joint, f in zip(data.joints, floors, strict=True)},
    )
    outcome = additions.in_log_units(outcome)
    name = "the replay of whole recordings"
    outcome = additions.added(outcome, name, lambda d: additions.replayed(d, prepared, settings))
    if on_verdict is not None:
        on_verdict(outcome)
    steps: dict[str, additions.Step] = {
        "the causes' test for numerics": lambda d: additions.tested(d, prepared, settings),
        "the pictures of recordings": lambda d: additions.pictured(d, made, data, floors),
        "the other channels": lambda d: additions.witnessed(d, data),
        "the closed loop": lambda d: additions.played(d, logs, load_player, actor, seed, settings),
        "the next experiment": lambda d: additions.planned(d, data, seed),
    }
    for name, step in steps.items():
        outcome = additions.added(outcome, name, step)
    on_progress("done", 1.0)
    return outcome._replace(report=replace(outcome.report, seconds=time.monotonic() - start))


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _inputs(
    data: Data, fold: np.ndarray, model: str | Path | None, seed: int, exclude: Sequence[str]
) -> dict[str, object]:
    paths = [str(log.path) for log in data.logs if log.path]
    own = [str(log.model) for log in data.logs if log.model]
    return {
        "logs": paths,
        "models": sorted({str(model)} if model else set(own)),
        "seed": seed,
        "exclude": list(exclude),
        "made": datetime.datetime.now().astimezone().isoformat(" ", "minutes"),
        "versions": {"sim2real": metadata.version("sim2real"), "mujoco": mujoco.__version__},
        "robots": sorted({str(log.meta["robot"]) for log in data.logs if log.meta.get("robot")}),
        "sha256": {path: _sha256(Path(path)) for path in paths if Path(path).is_file()},
        "folds": _folds(data, fold),
        "link": links(data.logs),
    }


def _folds(data: Data, fold: np.ndarray) -> str:
    """Return how windows were dealt, and what the two folds have in common."""
    text = f"{sum(fold == 0)} and {sum(fold == 1)} windows, each judged by the other's fit"
    episodes = [
        {(w.log, w.episode) for w, f in zip(data.windows, fold, strict=True) if f == side}
        for side in (0, 1)
    ]
    if episodes[0].isdisjoint(episodes[1]):
        return text
    return (
        f"{text}; both are from the same episodes, so that what changes from one recording to the "
        "next (heat, mounting) widens no interval"
    )
