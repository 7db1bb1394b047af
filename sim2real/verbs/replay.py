"""The verb `replay`: how far a log is from its simulation, with nothing fitted.

The time that the robot's bus takes (`command_delay` in the log's metadata) is part of the model.
"""

from __future__ import annotations

from pathlib import Path

from envs.effects.file import load_effects
from hardware.log import read_logs
from sim2real.diagnosis.data.recording import load_model
from sim2real.diagnosis.data.replay import Gap, measure, write
from sim2real.runs.errors import Sim2RealError


def run(
    *,
    log: str | list[str] | None,
    model: str | None,
    effects: str | None,
    out: Path,
) -> list[Gap]:
    """Score logs under a model.

    Args:
        log: a log, a folder of logs, or a list of these.
        model: an MJCF for all logs; None takes the one that each log names.
        effects: an effects.yaml that is put into the model; None for the model as it is.
        out: the run's folder; gets replay.json, table.md, table.csv and plots/replay.png.

    Returns:
        A gap for each log.

    Raises:
        Sim2RealError: no log, or a log without a model.
        LogError: a log that is damaged, or names what the model lacks.
        EffectError: an effects file that is wrong, or an effect that the robot cannot have.
    """
    if not log:
        raise Sim2RealError("replay needs a recording; give log=PATH")
    fixed = [] if effects is None else load_effects(effects)
    gaps = [measure(one, load_model(one, model), fixed) for one in read_logs(log)]
    write(gaps, Path(out))
    return gaps
