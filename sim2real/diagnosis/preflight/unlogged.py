"""Joints that move and that a log does not hold.

    findings = check_unlogged(logs, specs)

A replay can only start such a joint where the model's keyframe `home` has it, at rest. That may be
right at the start of an episode; most windows start in the middle of one, where a base that walks,
or a pendulum that swings, is somewhere else.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.recording import columns_of
from sim2real.diagnosis.data.trial import choose, trial
from sim2real.diagnosis.schema import Finding
from sim2real.diagnosis.settings import DEFAULT, Settings


def check_unlogged(
    logs: Sequence[Log], specs: Sequence[mujoco.MjSpec], settings: Settings = DEFAULT
) -> list[Finding]:
    """Return a finding for each joint that moves in replays, and whose position is not logged.

    Args:
        logs: the logs.
        specs: the model of each.
        settings: what counts as a motion.
    """
    found: dict[str, Finding] = {}
    trials = settings.simulation
    for log, spec in zip(logs, specs, strict=True):
        model = spec.copy().compile()
        missing = [i for i in range(model.njnt) if not _is_logged(log, model, i)]
        if not missing:
            continue
        pieces = choose([log], trials.piece_s, trials.pieces)
        recordings = [piece.recording(model) for piece in pieces]
        paths = trial(spec, recordings) if recordings else []
        for joint in missing:
            moves = max((_motion(path, model, joint) for path in paths), default=0.0)
            if moves > settings.preflight.moved:
                name = model.joint(joint).name
                shown = f"a replay of {trials.piece_s:g} s moves {name} by {moves:.2g}"
                found.setdefault(name, _finding(log, model, joint, shown))
    return list(found.values())


def _is_logged(log: Log, model: mujoco.MjModel, joint: int) -> bool:
    return all(f"qpos.{name}" in log.columns for name in columns_of(model, joint)[0])


def _motion(path: np.ndarray, model: mujoco.MjModel, joint: int) -> float:
    """Return how far a joint moves from where it starts, until a simulation breaks."""
    first = int(model.jnt_qposadr[joint])
    own = path[:, first : first + len(columns_of(model, joint)[0])]
    return float(np.nanmax(np.abs(own - own[0])))


def _finding(log: Log, model: mujoco.MjModel, joint: int, shown: str) -> Finding:
    name, (places, speeds) = model.joint(joint).name, columns_of(model, joint)
    missing = [f"`qpos.{place}`" for place in places if f"qpos.{place}" not in log.columns]
    columns = missing[0] if len(missing) == 1 else f"{missing[0]} to {missing[-1]}"
    path = f"{log.path.name}: " if log.path else ""
    text = (
        f"{path}{columns} {'is' if len(missing) == 1 else 'are'} not logged, and {shown} (m, rad "
        "or parts of a quaternion). Windows that start in the middle of an episode put it at rest "
        "where the model's keyframe `home` has it. It was elsewhere, and the causes found may "
        "stand for that."
    )
    ends = f"`qvel.{speeds[0]}`" + (f" to `qvel.{speeds[-1]}`" if len(speeds) > 1 else "")
    fix = (
        f"Log {columns}, and {ends} if you can (motion capture, an estimator, an encoder); or hold "
        f"{name} still while you record, and lock it in the model."
    )
    return Finding("unlogged", name, text, fix)
