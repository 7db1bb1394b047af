"""Logs that a diagnosis cannot use, each with the reason and what to do."""

from collections.abc import Sequence

import mujoco
import numpy as np

from envs.models import FREE, columns_of
from hardware.log import Log
from sim2real.diagnosis.data.pairs import carriers
from sim2real.diagnosis.settings import DEFAULT, Settings
from sim2real.runs.errors import Sim2RealError

THOUSAND = 1000.0  # milliseconds in a second


def refuse_loose_base(log: Log, model: mujoco.MjModel, joints: Sequence[str]) -> None:
    """Raise Sim2RealError for a base that moves freely, carries compared joints and is not logged.

    A replay would start it at rest in its keyframe, in the middle of whatever it did.
    """
    bodies = [int(model.jnt_bodyid[model.joint(name).id]) for name in joints]
    above = {b for body in bodies for b in carriers(model, body)}
    for i in np.flatnonzero(model.jnt_type == FREE).tolist():
        body = int(model.jnt_bodyid[i])
        columns = [f"qpos.{name}" for name in columns_of(model, i)[0]]
        missing = [column for column in columns if column not in log.columns]
        if missing and body in above:
            name = model.joint(i).name or model.body(body).name
            raise Sim2RealError(
                f"{log.path or 'the log'}: the model's base {name!r} is free, and `{missing[0]}` "
                f"is not logged: its initial pose in each piece of the recording is unknown. Log "
                f"`{columns[0]}` to `{columns[-1]}` (motion capture, an estimator), and `qvel` if "
                "you can; or hold the base still while you record, and give a model whose base is "
                "fixed"
            )


def refuse_clock(log: Log, settings: Settings = DEFAULT) -> None:
    """Raise Sim2RealError for a log whose `time` can be no seconds: a replay would take hours.

    Nor may an episode last far longer than its rows do: whatever runs along the time of a log takes
    memory in proportion to its length, so that is at most `sparse` times what the rows take.
    """
    limits, place = settings.preflight, log.path or "the log"
    step = float(np.median(np.concatenate([np.diff(part.time) for part in log.episodes()])))
    least, most = limits.row_s
    if not least <= step <= most:
        factor = THOUSAND if step < least else 1 / THOUSAND
        raise Sim2RealError(
            f"{place}: its rows are {step:.4g} s apart, not {least:g} to {most:g} s; convert "
            f"`time` to seconds, for example multiply it by {factor:g}"
        )
    for part in log.episodes():
        steps = np.diff(part.time)
        usual, row = float(np.median(steps)), int(np.argmax(steps)) + 1
        if steps.sum() > limits.sparse * usual * len(part):
            raise Sim2RealError(
                f"{place}, episode {part.episode[0]}: row {row} is {steps[row - 1]:.4g} s after "
                f"the one before, where {usual:.3g} s are usual; correct its `time`, or begin "
                "another episode there"
            )
