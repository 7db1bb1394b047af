"""The exam on robots that another engine moves.

    exam = EngineExam(kinds=["single", "outside"], cases_per_kind=2, half="calibration", ...)
    outlines = exam.draw(seed=11)
    exam.make(outlines[0], logs, key)

The logs and the key of a case are those of the other exams: see `sim2real.exam.cases`. The two
halves are drawn from one seed and share no case: one is for mending and calibrating, the other is
opened once.
"""

import itertools
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

import numpy as np

from hardware.log import Log, write_log
from sim2real.exam.cases import write_task
from sim2real.exam.hold import KEY, Examiner, Outline, closed, read_case
from sim2real.exam.logs import overall
from sim2real.exam.measure import apart
from sim2real.exam.refit import RIVAL_FLOORS
from sim2real.exam.score import calibration, failures
from sim2real.exam.thirdparty import tables
from sim2real.exam.thirdparty.deviations import list_deviations
from sim2real.exam.thirdparty.engines import EngineName, check_engine
from sim2real.exam.thirdparty.kinds import KINDS, Kind, draws
from sim2real.exam.thirdparty.make import Made, make
from sim2real.exam.thirdparty.marks import Mark, mark
from sim2real.exam.thirdparty.refit import refits
from sim2real.exam.thirdparty.robots import ROBOTS, Robot, nominal, plan
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

Half = Literal["calibration", "sealed"]
REDRAWS = 8  # draws of other effects where a robot cannot show the first ones
AGAIN = 8.0  # s of the first motion that are driven twice: what noise does


@dataclass(frozen=True)
class EngineExam(Examiner):
    """The numbers of cases by kind.

    Raises:
        Sim2RealError: an unknown kind, half or engine, an engine that is not installed, or a number
            that is too small.
    """

    kinds: Sequence[Kind]  # which; see `sim2real.exam.thirdparty.kinds`
    cases_per_kind: int  # of each of them
    half: Half  # calibration (to look at and to develop with) or sealed (opened once)
    engine: EngineName  # what moves the robots: drake or dart
    seconds: float  # of each motion [s]
    skip: int = 0  # number of first cases to skip because they were opened before
    title: ClassVar[str] = "Blind check on robots of another engine"

    def __post_init__(self) -> None:
        super().__post_init__()
        wrong = [kind for kind in self.kinds if kind not in KINDS]
        if wrong or not self.kinds:
            raise Sim2RealError(
                f"exam.kinds={list(self.kinds)}: name at least one of {', '.join(KINDS)}"
            )
        if self.half not in get_args(Half):
            raise Sim2RealError(f"exam.half={self.half!r} must be {' or '.join(get_args(Half))}")
        if self.cases_per_kind < 1 or self.seconds < AGAIN:
            raise Sim2RealError(
                f"exam.cases_per_kind={self.cases_per_kind} must be at least 1, and "
                f"exam.seconds={self.seconds} at least {AGAIN:g}"
            )
        cases = len(self.kinds) * self.cases_per_kind
        if not 0 <= self.skip < cases:
            raise Sim2RealError(f"exam.skip={self.skip} must be from 0 to {cases - 1}")
        check_engine(self.engine)

    def draw(self, seed: int) -> list[Outline]:
        """Return the cases, the kinds in turn; the same seed gives the same ones."""
        root = np.random.SeedSequence([seed, get_args(Half).index(self.half)])
        streams = {str(kind): one for kind, one in zip(KINDS, root.spawn(len(KINDS)), strict=True)}
        found: list[Outline] = []
        bags = {kind: draws(kind, np.random.default_rng(streams[kind])) for kind in self.kinds}
        seeds = {
            kind: streams[kind].spawn(1)[0].generate_state(self.cases_per_kind) for kind in bags
        }
        for number in range(self.cases_per_kind):
            for kind, drawn in bags.items():
                robot, effects = next(drawn)
                name = f"case_{len(found):03d}"
                found.append(Outline(name, kind, robot, effects, int(seeds[kind][number])))
        return found[self.skip :]

    def make(self, outline: Outline, logs: Path, key: Path) -> bool:
        """Record a case; see `Examiner`.

        What a robot cannot show, and a law that the vocabulary refits, is drawn again.
        """
        again = draws(outline.kind, np.random.default_rng([outline.seed, 3]))  # type: ignore[arg-type]
        others = itertools.islice(again, REDRAWS)
        for robot, effects in ((outline.robot, outline.effects), *others):
            found = make(outline.kind, ROBOTS[robot], effects, outline.seed, self.engine)  # type: ignore[arg-type]
            one = replace(outline, robot=robot, effects=effects)
            if found is not None and self._write(one, found, logs, key):
                return True
        return False

    def mark(self, folder: Path, name: str) -> Mark:
        """Compare the answer to a case with its key."""
        key, report = read_case(folder, name)
        asked = report is not None and key["kind"] not in ("outside", "off_nominal")
        return mark(key, report, closed(folder, name, key["residue"]) if asked else None)

    def summarize(
        self, marks: Sequence[Mark], seed: int, plots: Path
    ) -> dict[str, tuple[str, Table]]:
        """Draw the recall; return the figures that the exam aims at, and further tables."""
        tables.draw(marks, plots / "recall.png")
        return {
            "lines": ("What was aimed at", tables.lines(marks)),
            "kinds": ("Kind by kind", tables.by_kind(marks, np.random.default_rng(seed))),
            "recall": ("Recall by effect and kind", tables.recall(marks)),
            "calibration": ("Is the confidence earned?", calibration(marks)),
            "failures": ("What was answered wrongly", failures(marks, "floors", "background")),
        }

    def _write(self, outline: Outline, made: Made, logs: Path, key: Path) -> bool:
        robot = ROBOTS[outline.robot]
        found = {}
        if outline.kind == "outside":
            found = refits(made, robot, outline.seed)
            if any(floors <= RIVAL_FLOORS for floors in found.values()):
                return False
        model = logs / "model.xml"
        recorded = self._record(robot, made, outline.seed, model)
        spec = nominal(robot)
        spec.compile()
        write_text(model, spec.to_xml())
        for name, log in recorded.items():
            if name != "bare":
                write_log((key if name == "held" else logs) / f"{name}.csv", log)
        write_task(logs, ())
        about = _about(outline, made) | {
            "engine": self.engine,
            "half": self.half,
            "refits": found,
            "residue": overall(apart(recorded["bare"], spec)),
        }
        write_text(key / KEY, json.dumps(about, indent=1) + "\n")
        return True

    def _record(self, robot: Robot, made: Made, seed: int, model: Path) -> dict[str, Log]:
        """Return the logs: two motions, the beginning of one again, one held back, one bare."""
        seeds = np.random.SeedSequence(seed).spawn(3)
        ctrl = {
            name: plan(robot, self.seconds, np.random.default_rng(s))
            for name, s in zip(("a", "b", "held"), seeds, strict=True)
        }
        ctrl["a_again"] = ctrl["a"][: round(AGAIN * robot.rate)]
        meta = {"model": str(model.resolve()), "robot": robot.name}
        rig = replace(made.rig, meta=meta)
        logs = {name: rig.drive(c, seed + 2 + i) for i, (name, c) in enumerate(ctrl.items())}
        return logs | {"bare": made.bare.drive(ctrl["held"], seed + 9)}


def _about(outline: Outline, made: Made) -> dict[str, Any]:
    tree = made.bare.tree
    return {
        "name": outline.name,
        "kind": outline.kind,
        "robot": outline.robot,
        "seed": outline.seed,
        "truths": list(made.truths),
        "deviations": list_deviations(made.rig, made.bare),
        "gap": made.gap,
        "floor": made.floor,
        "background": made.background,
        "joints": list(made.bare.driven),
        "bodies": {tree.mover(joint).body: joint for joint in made.bare.driven},
    }
