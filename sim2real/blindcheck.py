"""The verb `blindcheck`: hide effects, diagnose the logs without knowing them, score the answers.

    python -m sim2real run=blindcheck                                  # the exam of the docs: hours
    python -m sim2real +experiment=blindcheck_small                    # a sample of it
    python -m sim2real +experiment=blindcheck resume=outputs/mine      # go on where it stopped

Logs and model of each case lie in `logs/`, what was hidden in `keys/`; each diagnosis is a process
of its own that is given one folder of `logs/`, and leaves its answer in `answers/`. Only when all
have answered are the keys read, and checked against the hashes that were written with the logs.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import mujoco
import numpy as np

from envs.effects import load_effects
from envs.errors import EnvsError
from envs.plant import Fixed
from hardware.log import Log, read_log
from sim2real.blind import matrix, score, seal
from sim2real.blind.answer import EFFECTS, REPORT, answered, ask
from sim2real.blind.cases import KEY, Outline
from sim2real.blind.logs import overall
from sim2real.blind.measure import apart
from sim2real.blind.score import Mark
from sim2real.errors import Sim2RealError
from sim2real.files import write_text
from sim2real.tables import Table

log_ = logging.getLogger(__name__)
LOGS, KEYS, ANSWERS, DROPPED, HELD = "logs", "keys", "answers", "dropped.txt", "held.csv"
CONFIDENCES = (0.0, 0.5, 0.8, 0.9, 0.95, 1.001)  # edges of the table of calibration


class Examiner(Protocol):
    """What draws and makes the cases of an exam."""

    def draw(self, seed: int) -> list[Outline]:
        """Return the cases; the same seed gives the same ones."""
        ...

    def make(self, outline: Outline, logs: Path, key: Path) -> bool:
        """Write a case's two folders; False if it cannot be made."""
        ...


def run(*, exam: Examiner, seed: int, resume: str | None, out: Path) -> list[Mark]:
    """Make, diagnose and score an exam; what is there already is not made again.

    Args:
        exam: which cases.
        seed: of the draw.
        resume: the folder of an exam that was stopped; None starts one in `out`.
        out: the run's folder; gets logs/, keys/, answers/, table.md, the tables as CSV, score.json
            and plots/matrix.png.

    Returns:
        The marks of every case.

    Raises:
        Sim2RealError: keys that are not the ones that were sealed; an exam that holds no case.
    """
    folder = Path(resume) if resume else Path(out)
    names = prepare(exam, seed, folder)
    for done, name in enumerate(names):
        if not answered(folder / ANSWERS / name):
            log_.info("%s, %d of %d", name, done + 1, len(names))
            ask((folder / LOGS / name).resolve(), (folder / ANSWERS / name).resolve())
    return report(folder, names, seed)


def prepare(exam: Examiner, seed: int, folder: Path) -> list[str]:
    """Make the cases that are not there yet, close the seal, and return the names of all.

    Raises:
        Sim2RealError: not one case could be made.
    """
    logs, keys = folder / LOGS, folder / KEYS
    outlines = exam.draw(seed)
    for done, outline in enumerate(outlines):
        key = keys / outline.name
        if (key / KEY).is_file() or (key / DROPPED).is_file():
            continue
        log_.info("%s: making %d of %d", outline.name, done + 1, len(outlines))
        if not exam.make(outline, logs / outline.name, key):
            effects = ", ".join(outline.effects)
            write_text(key / DROPPED, f"{outline.robot} cannot show {effects}\n")
    names = [one.name for one in outlines if (keys / one.name / KEY).is_file()]
    if not names:
        raise Sim2RealError(f"{folder}: not one case could be made; ask for more robots or cases")
    if not (logs / seal.SEAL).is_file():
        seal.close(keys, logs)
    return names


def report(folder: Path, names: Sequence[str], seed: int) -> list[Mark]:
    """Open the seals, mark every case, and write the tables and the picture.

    Raises:
        Sim2RealError: the keys are not the ones that were sealed.
    """
    seal.check(folder / KEYS, folder / LOGS)
    marks = [_mark(folder, name) for name in names]
    write(marks, _dropped(folder), folder, seed)
    return marks


def _mark(folder: Path, name: str) -> Mark:
    key = json.loads((folder / KEYS / name / KEY).read_text(encoding="utf-8"))
    file = folder / ANSWERS / name / REPORT
    answer = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None
    held = folder / KEYS / name / HELD
    closed = None
    if answer is not None and key["kind"] in ("one", "two") and held.is_file():
        known = folder / LOGS / name / "known.yaml"
        fixed = load_effects(known) if known.is_file() else []
        named = load_effects(file.with_name(EFFECTS))
        closed = closes(read_log(held), fixed, named, key["residue"])
    return score.mark(key, answer, closed)


def closes(
    log: Log, known: Sequence[Fixed], named: Sequence[Fixed], residue: float
) -> float | None:
    """Return what share of a log's closable gap the found effects close.

    None where they cannot be put into the model.

    Args:
        log: a recording that the diagnosis never saw; its metadata names the model.
        known: effects that the diagnosis was told of.
        named: those that it found.
        residue: what the model leaves where nothing is hidden [rad].
    """
    spec = mujoco.MjSpec.from_file(str(log.model))
    before = overall(apart(log, spec, known))
    try:
        after = overall(apart(log, spec, [*known, *named])) if named else before
    except EnvsError as error:
        log_.warning("the found effects cannot be replayed: %s", error)
        return None
    return (before - after) / max(before - residue, 1e-9)


def _dropped(folder: Path) -> list[str]:
    files = sorted((folder / KEYS).glob(f"*/{DROPPED}"))
    return [f"{file.parent.name}: {file.read_text(encoding='utf-8').strip()}" for file in files]


def write(marks: Sequence[Mark], dropped: Sequence[str], folder: Path, seed: int) -> None:
    """Write table.md with everything, each table as CSV, score.json and the matrix's picture."""
    rng = np.random.default_rng(0)
    counts = matrix.confusion(marks)
    parts: dict[str, tuple[str, Table]] = {
        "table": ("Figures", score.summary(marks, rng)),
        "calibration": ("Is the confidence earned?", score.calibration(marks, CONFIDENCES)),
        "matrix": ("Hidden against named first", matrix.table(counts)),
        "failures": ("What was answered wrongly", score.failures(marks)),
    }
    kinds = [one.kind for one in marks]
    head = f"{len(marks)} cases of seed {seed}: " + ", ".join(
        f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds)
    )
    text = [f"# Blind check\n\n{head}.\n"]
    for name, (title, table) in parts.items():
        text.append(f"## {title}\n\n{table.markdown()}")
        write_text(folder / f"{name}.csv", table.csv())
    if dropped:
        text.append("## Not drawn\n\n" + "\n".join(f"* {line}" for line in dropped) + "\n")
    write_text(folder / "table.md", "\n".join(text))
    write_text(folder / "cases.csv", score.cases(marks).csv())
    figures = {str(row[0]): row[1:] for row in parts["table"][1].rows}
    write_text(folder / "score.json", json.dumps({"seed": seed, "figures": figures}, indent=1))
    matrix.draw(counts, folder / "plots" / "matrix.png")
    log_.info("%s", parts["table"][1].markdown())
