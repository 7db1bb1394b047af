"""What a log says of itself before any physics is blamed.

    findings = preflight(logs, specs)
    [f for f in findings if f.check not in NOTES]       # what should be corrected

Each finding says in plain sentences what was found and what to do about it. Those of `NOTES` only
tell what the sensors are like; every other one should be corrected before a physical cause is
sought.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence

import mujoco
import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.noise_floor import count_of, noise_floor
from sim2real.diagnosis.data.pairs import Pairs
from sim2real.diagnosis.data.poses import find_led, home, positions
from sim2real.diagnosis.data.recording import columns_of
from sim2real.diagnosis.data.trial import choose, trial
from sim2real.diagnosis.preflight import channels
from sim2real.diagnosis.preflight.clocks import check_clocks
from sim2real.diagnosis.preflight.lag import check_lag
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Settings

Check = Callable[[Sequence[Log], Sequence[mujoco.MjModel]], Iterable[Finding]]
BLOCKING = ("range", "rate", "no_command")  # such a log says nothing of the robot
NOTES = (
    *("quantization", "noise", "velocity_filter", "unsigned", "computed_torque"),
    *("base", "reading"),
)
ORDER = (*BLOCKING, "excitation")

CHECKS: list[Check] = []  # those of users, after this project's own


def register(check: Check) -> Check:
    """Ask a further check in every preflight; return it, so that this can be a decorator.

    It is given the logs and the compiled model of each, and returns findings.
    """
    CHECKS.append(check)
    return check


def preflight(
    logs: Sequence[Log], specs: Sequence[mujoco.MjSpec], settings: Settings = DEFAULT
) -> list[Finding]:
    """Return what is wrong with logs and their models, the gravest finding first.

    Logs that share a model share its spec.

    Raises:
        EnvsError: a model that cannot be simulated.
    """
    made = {id(spec): spec.copy().compile() for spec in specs}
    models = [made[id(spec)] for spec in specs]
    pairs = list(zip(logs, models, strict=True))
    found = [finding for check in channels.CHECKS for finding in check(pairs, settings)]
    found += check_clocks(logs, settings)
    if not any(finding.check in BLOCKING for finding in found):
        found += check_lag(pairs, specs, settings)
    if not any(finding.check == "rate" for finding in found):
        found += _noise(logs, settings)
    found += check_unlogged(pairs, specs, settings)
    found += [finding for check in CHECKS for finding in check(logs, models)]
    return sorted(found, key=_rank)


def _noise(logs: Sequence[Log], settings: Settings) -> Iterator[Finding]:
    """Joints whose readings scatter by more than their counts."""
    for joint, floor in noise_floor(logs, settings).items():
        if floor > max(count_of(logs, joint, settings), settings.preflight.count_min):
            yield Finding(
                "noise",
                joint,
                f"The positions of {joint} differ by {floor:.2g} (RMS) from what repeats of "
                "the same commands, or neighbouring rows, let expect.",
                "No action needed: no model comes closer than that to a single run.",
            )


def check_unlogged(
    pairs: Pairs, specs: Sequence[mujoco.MjSpec], settings: Settings = DEFAULT
) -> list[Finding]:
    """Return a finding for each joint that moves in replays, and whose position is not logged.

    A replay can only start such a joint where the model's keyframe `home` has it, at rest. That may
    be right at the start of an episode; most windows start in the middle of one, where a base that
    walks, or a pendulum that swings, is somewhere else.
    """
    found: dict[str, Finding] = {}
    trials = settings.simulation
    for (log, model), spec in zip(pairs, specs, strict=True):
        places = [[f"qpos.{name}" for name in columns_of(model, i)[0]] for i in range(model.njnt)]
        led = find_led(model, home(model)[0], positions(log, model).values())
        missing = [i for i, own in enumerate(places) if not log.columns.keys() >= {*own}]
        missing = [i for i in missing if i not in led]
        pieces = choose([log], trials.piece_s) if missing else []
        paths = trial(spec, [piece.recording(model) for piece in pieces])
        for joint in missing:
            own = int(model.jnt_qposadr[joint]) + np.arange(len(places[joint]))
            moves = [float(np.nanmax(np.abs(path[:, own] - path[0, own]))) for path in paths]
            if max(moves, default=0.0) > settings.preflight.moved:
                name = model.joint(joint).name
                shown = f"a replay of {trials.piece_s:g} s moves {name} by {max(moves):.2g}"
                found.setdefault(name, _unlogged(log, model, joint, shown))
    return list(found.values())


def _unlogged(log: Log, model: mujoco.MjModel, joint: int, shown: str) -> Finding:
    name, (places, speeds) = model.joint(joint).name, columns_of(model, joint)
    missing = [f"`qpos.{place}`" for place in places if f"qpos.{place}" not in log.columns]
    columns, are = (
        (missing[0], "is") if len(missing) == 1 else (f"{missing[0]} to {missing[-1]}", "are")
    )
    path = f"{log.path.name}: " if log.path else ""
    text = (
        f"{path}{columns} {are} not logged, and {shown} (m, rad or parts of a quaternion). Windows "
        "that start in the middle of an episode put it at rest where the model's keyframe `home` "
        "has it. It was elsewhere, and the causes found may stand for that."
    )
    ends = f"`qvel.{speeds[0]}`" + (f" to `qvel.{speeds[-1]}`" if len(speeds) > 1 else "")
    fix = (
        f"Log {columns}, and {ends} if you can (motion capture, an estimator, an encoder); or hold "
        f"{name} still while you record, and lock it in the model."
    )
    return Finding("unlogged", name, text, fix)


def _rank(finding: Finding) -> int:
    if finding.check in ORDER:
        return ORDER.index(finding.check)
    return len(ORDER) + (finding.check in NOTES)
