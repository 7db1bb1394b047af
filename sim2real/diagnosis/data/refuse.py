"""Logs that a diagnosis cannot use, each with the reason and what to do."""

from collections.abc import Sequence

import mujoco
import numpy as np

from hardware.log import Log
from sim2real.diagnosis.data.pairs import carriers
from sim2real.diagnosis.data.recording import columns_of
from sim2real.diagnosis.settings import DEFAULT, Settings
from sim2real.runs.errors import Sim2RealError

FREE = int(mujoco.mjtJoint.mjJNT_FREE)
THOUSAND = 1000.0  # milliseconds in a second


def refuse_loose_base(log: Log, model: mujoco.MjModel, joints: Sequence[str]) -> None:
    """Raise Sim2RealError for a base that moves freely, carries compared joints and is not logged.

    A replay would start it at rest in its keyframe, in the middle of whatever it did.
    """
    bodies = [int(model.jnt_bodyid[model.joint(name).id]) for name in joints]
    above = {b for body in bodies for b in carriers(model, body)}
    for i in range(model.njnt):
        if int(model.jnt_type[i]) != FREE or int(model.jnt_bodyid[i]) not in above:
            continue
        columns = [f"qpos.{name}" for name in columns_of(model, i)[0]]
        missing = [column for column in columns if column not in log.columns]
        if missing:
            name = model.joint(i).name or model.body(int(model.jnt_bodyid[i])).name
            raise Sim2RealError(
                f"{log.path or 'the log'}: the model's base {name!r} is free, and `{missing[0]}` "
                f"is not logged: its initial pose in each piece of the recording is unknown. Log "
                f"`{columns[0]}` to `{columns[-1]}` (motion capture, an estimator), and `qvel` if "
                "you can; or hold the base still while you record, and give a model whose base is "
                "fixed"
            )


def refuse_clock(log: Log, settings: Settings = DEFAULT) -> None:
    """Raise Sim2RealError for a log whose `time` can be no seconds: a replay would take hours."""
    least, most = settings.preflight.fastest_s, settings.preflight.slowest_s
    step = float(np.median(np.concatenate([np.diff(part.time) for part in log.episodes()])))
    if not least <= step <= most:
        factor = THOUSAND if step < least else 1 / THOUSAND
        raise Sim2RealError(
            f"{log.path or 'the log'}: its rows are {step:.4g} s apart, not {least:g} to {most:g} "
            f"s; convert `time` to seconds, for example multiply it by {factor:g}"
        )


def refuse_sparse(log: Log, settings: Settings = DEFAULT) -> None:
    """Raise Sim2RealError for an episode that lasts far longer than its rows do.

    Whatever runs along the time of a log takes memory in proportion to its length; so that is at
    most `sparse` times what the rows take.
    """
    most = settings.preflight.sparse
    for part in log.episodes():
        steps = np.diff(part.time)
        usual = float(np.median(steps))
        if steps.sum() > most * usual * len(part):
            row = int(np.argmax(steps)) + 1
            raise Sim2RealError(
                f"{log.path or 'the log'}, episode {part.episode[0]}: row {row} is "
                f"{steps[row - 1]:.4g} s after the one before, where {usual:.3g} s are usual; "
                "correct its `time`, or begin another episode there"
            )
