"""Joints that move and that a log does not hold.

    findings = check_unlogged(pairs, specs)

A replay can only start such a joint where the model's keyframe `home` has it, at rest. That may be
right at the start of an episode; most windows start in the middle of one, where a base that walks,
or a pendulum that swings, is somewhere else.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.pairs import Pairs
from sim2real.diagnosis.data.recording import columns_of
from sim2real.diagnosis.data.trial import choose, trial
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Settings


def check_unlogged(
    pairs: Pairs, specs: Sequence[mujoco.MjSpec], settings: Settings = DEFAULT
) -> list[Finding]:
    """Return a finding for each joint that moves in replays, and whose position is not logged."""
    found: dict[str, Finding] = {}
    trials = settings.simulation
    for (log, model), spec in zip(pairs, specs, strict=True):
        places = [[f"qpos.{name}" for name in columns_of(model, i)[0]] for i in range(model.njnt)]
        missing = [i for i, own in enumerate(places) if not log.columns.keys() >= {*own}]
        pieces = choose([log], trials.piece_s, trials.pieces) if missing else []
        paths = trial(spec, [piece.recording(model) for piece in pieces]) if pieces else []
        for joint in missing:
            own = int(model.jnt_qposadr[joint]) + np.arange(len(places[joint]))
            moves = [float(np.nanmax(np.abs(path[:, own] - path[0, own]))) for path in paths]
            if max(moves, default=0.0) > settings.preflight.moved:
                name = model.joint(joint).name
                shown = f"a replay of {trials.piece_s:g} s moves {name} by {max(moves):.2g}"
                found.setdefault(name, _finding(log, model, joint, shown))
    return list(found.values())


def _finding(log: Log, model: mujoco.MjModel, joint: int, shown: str) -> Finding:
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
