"""Holding an exam: hide effects, diagnose the logs without knowing them, score the answers.

    python -m sim2real run=blindcheck                                  # the exam of the docs: hours
    python -m sim2real +experiment=blindcheck_small                    # a sample of it
    python -m sim2real +experiment=blindcheck resume=outputs/mine      # go on where it stopped
    python -m sim2real +experiment=blindcheck resume=outputs/mine exam.most=0   # score it

Logs and model of each case lie in `logs/`, what was hidden in `keys/`. Cases come in blocks: all of
a block are made and sealed before the first one is diagnosed. Each diagnosis is a process of its
own that is given one folder of `logs/`, and leaves its answer in `answers/`. Only then are the keys
of the answered cases read, and checked against the hashes that were written with the logs.
"""

import json
import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import mujoco
import numpy as np

from envs.effects import load_effects, merge_effects
from envs.errors import EnvsError
from hardware.log import read_log
from sim2real.exam import matrix, score, seal
from sim2real.exam.answer import EFFECTS, REPORT, VERSION, answered, ask
from sim2real.exam.logs import overall
from sim2real.exam.measure import apart
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import folder_lock, write_text
from sim2real.runs.tables import Table

log_ = logging.getLogger(__name__)
LOGS, KEYS, ANSWERS, DROPPED, HELD = "logs", "keys", "answers", "dropped.txt", "held.csv"
CLAIMS = "claims"  # who of several programs works on which case
PATIENCE = 2.0  # s between looks at what another program does
KEY = "key.json"  # what a case's key is called in its folder
KNOWN = "known.yaml"  # effects that a diagnosis is given, if there are any


@dataclass(frozen=True)
class Outline:
    """A case as drawn: its name, kind, robot, effects and the seed of everything else."""

    name: str
    kind: str
    robot: str
    effects: tuple[str, ...]
    seed: int


@dataclass(frozen=True, kw_only=True)
class Examiner(ABC):
    """The base of exams: it draws and makes the cases, and marks the answers.

    Raises:
        Sim2RealError: one of these out of range.
    """

    longest: float  # time after which a diagnosis counts as failed [s]
    block: int  # make and seal so many cases before the first of them is diagnosed
    # diagnose at most so many cases now, and score what is answered; None goes to the end
    most: int | None = None
    title: ClassVar[str] = "Blind check"  # of table.md

    def __post_init__(self) -> None:
        if not self.longest > 0 or (self.most is not None and self.most < 0) or self.block < 1:
            raise Sim2RealError(
                f"longest={self.longest} must be above 0 s, most={self.most} at least 0, or null "
                f"for all, and block={self.block} at least 1"
            )

    @abstractmethod
    def draw(self, seed: int) -> list[Outline]:
        """Return the cases; the same seed gives the same ones."""

    @abstractmethod
    def make(self, outline: Outline, logs: Path, key: Path) -> bool:
        """Record a case and write its two folders; False if the robot cannot show its effect.

        Args:
            outline: the case.
            logs: the folder that a diagnosis is given.
            key: the folder that it is not.
        """

    def report(self, folder: Path, drawn: int, seed: int) -> Sequence[Any]:
        """Open the seals, mark every case that was answered, and write tables and pictures.

        Args:
            folder: the folder of the exam.
            drawn: cases that it has, with those that could not be made.
            seed: the seed of its draw.

        Raises:
            Sim2RealError: the keys are not the ones that were sealed, no case could be made, or
                none was answered.
        """
        names, cases = opened(folder, drawn)
        marks = [self.mark(folder, name) for name in names]
        self._write_report(folder, marks, seed, cases)
        return marks

    def _write_report(self, folder: Path, marks: Sequence[Any], seed: int, cases: int) -> None:
        """Write table.md with every table, each as CSV, cases.csv, and score.json with figures."""
        tables = self.summarize(marks, seed, folder / "plots")
        files = [folder / ANSWERS / one.case / VERSION for one in marks]
        found = [f.read_text(encoding="utf-8").strip() if f.is_file() else "unknown" for f in files]
        versions = {name: found.count(name) for name in dict.fromkeys(found)}
        partial = len(marks) < cases
        hours = sum(one.seconds or 0.0 for one in marks) / 3600
        answered = ", ".join(f"{count} by {name}" for name, count in versions.items())
        text = [
            f"# {self.title}\n\n{'**partial: true.** ' if partial else ''}{len(marks)} of {cases} "
            f"cases of seed {seed} were answered, {answered}, in {hours:.2f} hours of diagnoses.\n"
        ]
        for name, (head, table) in tables.items():
            text.append(f"## {head}\n\n{table.markdown()}")
            write_text(folder / f"{name}.csv", table.csv())
        if dropped := sorted((folder / KEYS).glob(f"*/{DROPPED}")):
            lines = [f"* {f.parent.name}: {f.read_text(encoding='utf-8')}" for f in dropped]
            text.append(f"## Not drawn\n\n{''.join(lines)}")
        write_text(folder / "table.md", "\n".join(text))
        write_text(folder / "cases.csv", score.cases(marks).csv())
        _, first = next(iter(tables.values()))
        about = {"seed": seed, "cases": cases, "answered": len(marks), "partial": partial}
        figures = {str(row[0]): row[1:] for row in first.rows}
        about |= {"versions": versions, "figures": figures}
        write_text(folder / "score.json", json.dumps(about, indent=1))
        log_.info("%s", first.markdown())

    def mark(self, folder: Path, name: str) -> Any:
        """Compare the answer to a case with its key; return a dataclass, `case` its name."""
        key, report = read_case(folder, name)
        asked = report is not None and key["kind"] in ("one", "two")
        return score.mark(key, report, closed(folder, name, key["residue"]) if asked else None)

    def summarize(
        self, marks: Sequence[Any], seed: int, plots: Path
    ) -> dict[str, tuple[str, Table]]:
        """Draw pictures into a folder; return titles and tables by file name, the figures first."""
        counts = matrix.confusion(marks)
        matrix.draw(counts, plots / "matrix.png")
        return {
            "table": ("Figures", score.summary(marks, np.random.default_rng(seed))),
            "calibration": ("Is the confidence earned?", score.calibration(marks)),
            "matrix": ("Hidden against named first", matrix.table(counts)),
            "failures": ("What was answered wrongly", score.failures(marks)),
        }


def check_data(data: str | None, part: str, name: str) -> None:
    """Check that the folder of real logs holds a file that a case or robot needs.

    Raises:
        Sim2RealError: no folder, or one without it.
    """
    if not data or not Path(data, part).is_file():
        raise Sim2RealError(
            f"exam.data={data or None} has no {part}, which {name} needs; set the environment "
            f"variable SIM2REAL_DATA to the folder of real logs (docs/explanation/evidence.md "
            f"names the public sources)"
        )


def hold(exam: Examiner, outlines: Sequence[Outline], folder: Path) -> None:
    """Make, seal and diagnose one block of cases after the other, till `most` were asked."""
    left = exam.most
    for start in range(0, len(outlines), exam.block):
        if left == 0:
            return
        names = prepare(exam, outlines[start : start + exam.block], folder)
        asked = diagnose(names, folder, exam.longest, left)
        left = None if left is None else left - asked


def prepare(exam: Examiner, block: Sequence[Outline], folder: Path) -> list[str]:
    """Make the cases that are not there yet, seal them, and return the names of those to ask."""
    keys, logs = folder / KEYS, folder / LOGS
    outlines = {one.name: one for one in block}

    def made(name: str) -> bool:
        return (keys / name / KEY).is_file() or (keys / name / DROPPED).is_file()

    def make(name: str) -> None:
        log_.info("%s: making it", name)
        outline = outlines[name]
        if not exam.make(outline, logs / name, keys / name):
            effects = ", ".join(outline.effects)
            write_text(keys / name / DROPPED, f"{outline.robot} cannot show {effects}\n")

    share(list(outlines), made, make, folder / CLAIMS / "making")
    with folder_lock(folder / CLAIMS / "seal") as mine:
        if mine and not outlines.keys() <= set(seal.cases(logs)):
            seal.close(keys, logs, outlines)
    return [name for name in outlines if (keys / name / KEY).is_file()]


def diagnose(names: Sequence[str], folder: Path, longest: float, most: int | None) -> int:
    """Ask for missing answers, up to a maximum number; return how many were asked for."""
    left = [name for name in names if not answered(folder / ANSWERS / name)][:most]

    def ask_one(name: str) -> None:
        log_.info("%s, %d to go", name, len(left) - left.index(name))
        logs, answer = folder / LOGS / name, folder / ANSWERS / name
        ask(logs.resolve(), answer.resolve(), longest)

    share(left, lambda name: answered(folder / ANSWERS / name), ask_one, folder / CLAIMS / "asking")
    return len(left)


def share(
    names: Sequence[str], done: Callable[[str], bool], do: Callable[[str], None], claims: Path
) -> None:
    """Do the open pieces of work, shared with other programs; wait for those at the end.

    In the folder of claims each piece's folder says who works on it.
    """
    while True:
        for name in names:
            if not done(name):
                with folder_lock(claims / name) as mine:
                    if mine and not done(name):
                        do(name)
        if all(done(name) for name in names):
            return
        time.sleep(PATIENCE)


def opened(folder: Path, drawn: int) -> tuple[list[str], int]:
    """Check the seals; return the names of the answered cases, and how many there are in all.

    Raises as `Examiner.report`.
    """
    keys, logs = folder / KEYS, folder / LOGS
    seal.check(keys, logs)
    sealed = seal.cases(logs)
    names = [name for name in sealed if (keys / name / KEY).is_file()]
    if not names:
        raise Sim2RealError(f"{folder}: no case could be created; choose more robots or cases")
    done = [name for name in names if answered(folder / ANSWERS / name)]
    if not done:
        raise Sim2RealError(f"{folder}: no case was answered; start again with resume=")
    return done, drawn - len(sealed) + len(names)


def read_case(folder: Path, name: str) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Return a case's key and its answer; None of a diagnosis that failed."""
    key = json.loads((folder / KEYS / name / KEY).read_text(encoding="utf-8"))
    file = folder / ANSWERS / name / REPORT
    return key, json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None


def closed(folder: Path, name: str, residue: float) -> float | None:
    """Return the fraction of the closable gap that an answer's effects close.

    None where they cannot be put into the model. The gap is that of the log that was held back,
    without the residue [rad] that the model leaves where nothing is hidden.
    """
    log, file = read_log(folder / KEYS / name / HELD), folder / LOGS / name / KNOWN
    known = load_effects(file) if file.is_file() else []
    named = load_effects(folder / ANSWERS / name / EFFECTS)
    spec = mujoco.MjSpec.from_file(str(log.model))
    before = overall(apart(log, spec, known))
    try:
        after = overall(apart(log, spec, merge_effects(known, named))) if named else before
    except EnvsError as error:
        log_.warning("the found effects cannot be replayed: %s", error)
        return None
    return (before - after) / max(before - residue, 1e-9)
