"""The verb `diagnose`: which unmodelled effect separates a robot's logs from its simulation.

python -m sim2real run=diagnose log=swing.csv model=arm.xml
python -m sim2real run=diagnose log=logs/ exclude=[backlash]

report = diagnose("logs/", "arm.xml")
report.verdict, [(cause.effect, cause.where, cause.value) for cause in report.causes]
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from hardware.log import Log
from sim2real.diagnosis.report import Report

Progress = Callable[[str, float], None]  # what is being tried, and the share of the work done


def diagnose(
    logs: str | Path | Iterable[str | Path | Log],
    model: str | Path | None = None,
    *,
    effects: str | Path | None = None,
    exclude: Sequence[str] = (),
    seed: int = 0,
    progress: Progress | None = None,
) -> Report:
    """Locate a gap, name what causes it, and say how much is left once it is added.

    Args:
        logs: a log, a folder of logs, or a list of these or of logs in memory.
        model: an MJCF for all logs; None takes the one that each log names.
        effects: an effects.yaml of what is known already; put into the model first.
        exclude: names of effects that are left out of the candidates.
        seed: of the bootstrap and of where the fits start.
        progress: told what is being tried and the share of the work that is done.

    Returns:
        The report; `report.evidence` holds what its pictures show.

    Raises:
        Sim2RealError: no model, an unknown effect to exclude, a joint that never moved, a log
            too short, a model that diverges.
        LogError: a log that is damaged, or names what the model lacks.
        EffectError: an effects file that is wrong, or an effect that the robot cannot have.
    """
    raise NotImplementedError
