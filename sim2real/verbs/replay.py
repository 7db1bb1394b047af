"""The verb `replay`, the first look: how far a log is from its simulation, and what looks wrong.

    python -m sim2real run=replay log=swing.csv model=arm.xml
    python -m sim2real run=replay log=logs/ effects=effects.yaml

The recorded commands go into the model, and the positions that come out are compared with the
measured ones, each at the moment when it was read (`stamp.<joint>`, where the log has it). The
time that the robot's bus takes (`command_delay` in the log's metadata) is part of the model.
`effects` puts known effects into the simulator first: the difference of the two gaps is what they
explain. What preflight finds is said before, and so are mistakes in the log that explain the gap by
themselves: they make a gap that no robot has. What cannot be compared at all is refused: positions
where the model takes torques, a base that moves freely and of which neither pose nor IMU was
logged.
"""

import logging
from collections.abc import Sequence
from pathlib import Path

import mujoco

from envs.effects.file import load_effects
from envs.plant import Fixed
from hardware.log import Log, read_logs
from sim2real.diagnosis.data.dataset import Data
from sim2real.diagnosis.data.recording import check_log, load_model
from sim2real.diagnosis.data.refuse import refuse_clock, refuse_kinds, refuse_loose_base
from sim2real.diagnosis.data.replay import Gap, measure, write
from sim2real.diagnosis.ground.estimate import estimate_all
from sim2real.diagnosis.inference.run import find_mistakes
from sim2real.diagnosis.preflight.checks import NOTES, preflight
from sim2real.diagnosis.settings import DEFAULT
from sim2real.runs.errors import Sim2RealError

log_ = logging.getLogger(__name__)


def run(
    *, log: str | list[str] | None, model: str | None, effects: str | None, out: Path
) -> list[Gap]:
    """Score logs under a model.

    Args:
        log: a log, a folder of logs, or a list of these.
        model: an MJCF for all logs; None: the model that each log names.
        effects: an effects.yaml that is put into the model; None for the model as it is.
        out: the run's folder; gets replay.json, table.md, table.csv and plots/replay.png.

    Returns:
        A gap for each log.

    Raises:
        Sim2RealError: no log, or a log without a model, or one that its model cannot replay.
        LogError: a log that is damaged, or names what the model lacks.
        EffectError: an effects file that is wrong, or an effect that the robot cannot have.
    """
    if not log:
        raise Sim2RealError("replay needs a recording; give log=PATH")
    fixed = [] if effects is None else load_effects(effects)
    logs = read_logs(log)
    specs = [load_model(one, model) for one in logs]
    estimates = estimate_all(logs, model, DEFAULT.ground)
    seen = [one.log for one in estimates] or logs
    for one, spec in zip(seen, specs, strict=True):
        _check(one, spec)
    _look(seen, specs)
    if not estimates:
        _look_for_mistakes(seen, model, fixed)
    gaps = [measure(one, spec, fixed) for one, spec in zip(logs, specs, strict=True)]
    write(gaps, Path(out))
    return gaps


def _check(log: Log, spec: mujoco.MjSpec) -> None:
    """Refuse a log that cannot be compared with its model."""
    model = spec.copy().compile()
    check_log(log, model)
    refuse_clock(log)
    refuse_loose_base(log, model, log.joints)
    refuse_kinds(log, spec)


def _look_for_mistakes(logs: Sequence[Log], model: str | None, fixed: Sequence[Fixed]) -> None:
    """Warn of mistakes in a log that explain the gap by themselves."""
    try:
        remedies = find_mistakes(Data.of(logs, model), fixed)
    except Sim2RealError as error:
        log_.info("mistakes in the log were not looked for: %s", error)
        return
    for remedy in remedies:
        log_.warning("the log looks wrong, and right with this: %s", remedy)


def _look(logs: Sequence[Log], specs: Sequence[mujoco.MjSpec]) -> None:
    """Warn of what preflight finds; what the sensors are like is left to a diagnosis."""
    for finding in preflight(logs, specs):
        if finding.check not in NOTES:
            log_.warning("%s: %s %s", finding.check, finding.finding, finding.fix)
