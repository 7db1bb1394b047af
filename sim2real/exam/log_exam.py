"""An exam of logs with a mistake in them: is it named for what it is, and never explained away.

    python -m sim2real +experiment=blindcheck_logs                              # 60 cases
    python -m sim2real +experiment=blindcheck_logs resume=outputs/mine exam.most=12

The robots are emulated ones; in some of them an effect is hidden as well. Rules:

* A mistake is named if a cause of kind `log`, or an equivalent of it, has its kind and its place,
  and a size within `NEAR`. Of a mistake in all joints, the robot or any joint is its place.
* An answer is wrong for good if it is called `explained` and no cause is a mistake in the log: the
  robot is then blamed for what was written.
* A mistake that leaves the log as near to its simulation as before is drawn again.
* A hidden effect is found if a cause of kind `robot` has its name and place.
"""

import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import mujoco
import numpy as np

from hardware.config import load_robot
from hardware.errors import HardwareError
from hardware.log import Log, write_log
from sim2real.exam.cases import evenly, write_task
from sim2real.exam.hiding import EFFECTS
from sim2real.exam.hold import KEY, Examiner, Outline, read_case
from sim2real.exam.log_mistakes import KINDS, PAIRED, Mistake, draw_mistake
from sim2real.exam.logs import drive, exam_robot, plans
from sim2real.exam.measure import apart
from sim2real.exam.score import cases, wilson, words
from sim2real.exam.sizes import COUNT, Hidden, entries, hide
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

log_ = logging.getLogger(__name__)
REDRAWS = 20  # of a mistake, where the log does not show the first one
NEAR = 0.1  # relative error of a mistake's size that passes
COLUMNS = ("episode", "time", "ctrl", "qpos", "qvel", "torque", "stamp", "flag")  # that are logged
# Effects that a mistake could be taken for are not hidden together with it.
BESIDE = tuple(
    name
    for name in EFFECTS
    if name not in ("command_delay", "observation_delay", "encoder_offset", "gravity_tilt")
)


@dataclass(frozen=True)
class LogMark:
    """The result of one case."""

    case: str  # its name
    robot: str  # its name
    mistake: str  # the mistake in words
    hidden: str  # the effect that is hidden as well, "" for none
    answer: str  # verdict and causes in words
    named: bool  # whether the mistake is named
    blamed: bool  # whether the robot is: called `explained` without a mistake in the log
    found: bool | None  # whether the effect is named; None where there is none
    seconds: float | None  # the duration of the diagnosis; None if it failed


@dataclass(frozen=True)
class LogExam(Examiner):
    """The number of cases, and their robots.

    Raises:
        Sim2RealError: no robot, no case, or more with an effect than there are.
    """

    robots: Sequence[str]  # names of conf/robot; one of them has two joints
    count: int  # cases
    beside: int  # of these, cases with a hidden effect as well
    title: ClassVar[str] = "Mistakes of logs"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.robots or self.count < 1 or not 0 <= self.beside <= self.count:
            raise Sim2RealError(
                f"an exam of robots={list(self.robots)}, count={self.count} and "
                f"beside={self.beside} cannot be drawn. Name a robot, and give a count of at "
                "least 1 and a number of cases with an effect (`beside`) from 0 to count."
            )

    def draw(self, seed: int) -> list[Outline]:
        """Return the cases: every kind and robot equally often, as far as the count allows."""
        rng = np.random.default_rng([seed, 0])
        several = [name for name in self.robots if len(load_robot(name).names) > 1]
        kinds = [kind for kind in KINDS if several or kind not in PAIRED]
        chosen = evenly(kinds, self.count, rng)
        robots = evenly(self.robots, self.count, rng)
        effects = iter(evenly(BESIDE, self.beside, rng))
        both = set(rng.choice(self.count, self.beside, replace=False).tolist())
        seeds = np.random.SeedSequence(seed).generate_state(self.count)
        outlines = []
        for i, (kind, robot) in enumerate(zip(chosen, robots, strict=True)):
            if kind in PAIRED and robot not in several:
                robot = str(rng.choice(several))
            hidden = (next(effects),) if i in both else ()
            outlines.append(Outline(f"case_{i:03d}", kind, robot, hidden, int(seeds[i])))
        return outlines

    def make(self, outline: Outline, logs: Path, key: Path) -> bool:
        """Record a case; see `Examiner`."""
        robot = exam_robot(outline.robot, logs)
        hidden: Hidden | None = Hidden((), 0.0, 0.0)
        if outline.effects:
            hidden = hide(robot, outline.effects, outline.seed)
        if hidden is None:
            return False
        plan = plans(robot, outline.seed)["a"]
        try:
            log = drive(robot, entries(hidden.truths), plan, outline.seed + 2)
        except HardwareError as stopped:
            log_.debug("%s: %s", robot.name, stopped)
            return False
        rng = np.random.default_rng([outline.seed, 4])
        spec = mujoco.MjSpec.from_file(str(robot.model))
        drawn = (draw_mistake(rng, log, outline.kind) for _ in range(REDRAWS))
        mistake = next((one for one in drawn if shows(one, log, spec)), None)
        if mistake is None:
            return False
        write_log(logs / "a.csv", mistake.apply(_plain(log)))
        write_task(logs, ())
        truth = {
            "name": outline.name,
            "robot": outline.robot,
            "joints": log.joints,
            "mistake": mistake.to_json(),
            "truths": hidden.truths,
        }
        write_text(key / KEY, json.dumps(truth, indent=1) + "\n")
        return True

    def mark(self, folder: Path, name: str) -> LogMark:
        """Compare the answer to a case with its key."""
        return mark(*read_case(folder, name))

    def summarize(
        self, marks: Sequence[LogMark], seed: int, plots: Path
    ) -> dict[str, tuple[str, Table]]:
        """Return the figures and all cases; see `Examiner`."""
        return {"table": ("Figures", summary(marks)), "cases": ("Cases", cases(marks))}


def shows(mistake: Mistake, log: Log, spec: mujoco.MjSpec) -> bool:
    """Return whether a mistake changes how far a log is from its simulation.

    Where commands and readings of a symmetric joint are both reversed, the log is that of its
    mirror image, and as right as before.
    """
    before, after = apart(log, spec), apart(mistake.apply(log), spec)
    return not bool(np.abs(after - before).max() <= COUNT)  # a replay that fails shows it, too


def mark(key: Mapping[str, Any], report: Mapping[str, Any] | None) -> LogMark:
    """Compare an answer with its key.

    Args:
        key: {name, robot, joints, mistake, truths}.
        report: report.json; None if the diagnosis failed.
    """
    mistake = Mistake.from_json(key["mistake"])
    causes = [] if report is None else report["causes"]
    logs = [cause for cause in causes if cause.get("kind") == "log"]
    truths = [(t["effect"], t["joint"]) for t in key["truths"]]
    found = {
        (one["effect"], one["where"])
        for cause in causes
        if cause.get("kind", "robot") == "robot"
        for one in (cause, *cause["equivalent"])
    }
    return LogMark(
        key["name"],
        key["robot"],
        mistake.describe(),
        ", ".join(f"{effect} at {where or 'the robot'}" for effect, where in truths),
        "failed" if report is None else words(report),
        any(names(cause, mistake, key["joints"]) for cause in logs),
        report is not None and report["verdict"] == "explained" and not logs,
        bool(set(truths) & found) if truths else None,
        None if report is None else report["seconds"],
    )


def names(cause: Mapping[str, Any], mistake: Mistake, joints: Sequence[str]) -> bool:
    """Return whether a cause of kind `log` is this mistake."""
    places = {mistake.joint, mistake.other} - {None}
    if mistake.joint is None or len(joints) == 1:
        places = {None, *joints}
    every = (cause, *cause["equivalent"])
    if not any(one["effect"] == mistake.kind and one["where"] in places for one in every):
        return False
    if cause["effect"] != mistake.kind:  # an equivalent is the mistake: its size is unknown
        return True
    value = cause["value"]
    if mistake.kind == "row_shift" and cause["extra"]["columns"] != list(mistake.columns):
        value = -value  # a late command is an early reading: no log says which
    return abs(value - mistake.value) <= NEAR * abs(mistake.value)


def _plain(log: Log) -> Log:
    """Return a log with the columns that any client writes."""
    kept = {n: v for n, v in log.columns.items() if n.partition(".")[0] in COLUMNS}
    return replace(log, columns=kept)


def summary(marks: Sequence[LogMark]) -> Table:
    """Return the figures of the exam, each with its number of cases, interval and aim."""
    table = Table(("figure", "cases", "value", "aim"))

    def add(label: str, hits: list[bool], aim: str) -> None:
        table.add(label, len(hits), wilson(hits), aim)

    add("mistake named", [one.named for one in marks], "≥ 0.9")
    add("explained by an effect instead", [one.blamed for one in marks], "0")
    add("hidden effect named, too", [one.found for one in marks if one.found is not None], "")
    for kind in KINDS:
        own = [one.named for one in marks if one.mistake.startswith(f"{kind} ")]
        if own:
            add(f"named, {kind}", own, "")
    table.notes.append("Brackets: 95 % intervals by Wilson (1927).")
    return table
