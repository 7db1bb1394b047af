"""The verb `blindcheck`: hide effects, diagnose the logs without knowing them, score the answers.

Cases come in blocks: all of a block are made and sealed before the first one is diagnosed. Each
diagnosis is a separate process that receives one folder of `logs/`. Only then are the keys of
the answered cases read, and checked against the hashes that were written with the logs.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from sim2real.exam import seal
from sim2real.exam.hold import LOGS, Examiner, hold
from sim2real.runs.errors import Sim2RealError


def run(*, exam: Examiner, seed: int, resume: str | None, out: Path) -> Sequence[Any]:
    """Make, diagnose and score an exam; what is there already is not made again.

    Several of these programs may work on one exam; the last one scores it.

    Args:
        exam: which cases; with `most: 0` none is made, and those answered are scored.
        seed: the seed of the draw.
        resume: the folder of an exam that was stopped; None starts one in `out`.
        out: the run's folder; gets logs/ (logs and model of each case), keys/ (what was hidden),
            answers/, table.md, the tables as CSV, score.json and pictures in plots/.

    Returns:
        The exam's marks of every case that was answered.

    Raises:
        Sim2RealError: keys that are not the ones that were sealed; an exam that holds no case, or
            none that was answered.
        KeyboardInterrupt: after Ctrl-C; the cases answered until then are scored.
    """
    folder = Path(resume) if resume else Path(out)
    outlines = exam.draw(seed)
    try:
        hold(exam, outlines, folder)
    except KeyboardInterrupt as stop:
        if seal.cases(folder / LOGS):
            try:
                exam.report(folder, len(outlines), seed)
            except Sim2RealError as none:  # was answered yet
                raise KeyboardInterrupt(str(none)) from stop
        raise
    return exam.report(folder, len(outlines), seed)
