"""Logs of robots whose differences from a model others have published: are they named, alone.

    SIM2REAL_DATA=/data python -m sim2real +experiment=real_robots

The data is public and not part of the project (docs/explanation/evidence.md names the sources).
What a model withholds is known, its true size only as well as its publishers could fit it. Rules:

* Every `Wanted` cause has to be named, or an equivalent of a cause has to be it; one with `at` has
  to be named once for each of these moments, within `NEAR` s.
* No other cause may be named, but where a case says so.
* The verdict has to be one of the case's.
"""

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from hardware.log import read_log, write_log
from sim2real.exam.cases import write_task
from sim2real.exam.hold import KEY, Examiner, Outline, check_data, read_case
from sim2real.exam.score import cases, wilson, words
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

NEAR = 0.2  # s: how near to its moment a push has to be


@dataclass(frozen=True)
class Wanted:
    """A cause that has to be named."""

    effect: Sequence[str]  # names of which it has to have one
    where: Sequence[str | None]  # places of which it has to have one; None is the robot
    # moments at which it acts, as (episode, s); none: throughout
    at: Sequence[tuple[int, float]] = ()

    def counts_in(self, causes: Sequence[Mapping[str, Any]]) -> bool:
        """Return whether it is named."""
        own = [cause for cause in causes if self.is_named_by(cause)]
        return all(any(_acts(cause, *moment) for cause in own) for moment in self.at) and bool(own)

    def is_named_by(self, cause: Mapping[str, Any]) -> bool:
        """Return whether a cause, or an equivalent of it, is this one."""
        every = (cause, *cause["equivalent"])
        return any(one["effect"] in self.effect and one["where"] in self.where for one in every)


@dataclass(frozen=True)
class Keyed:
    """One log and a model of its robot."""

    log: str  # the log's path in the folder of real logs
    model: str  # the model's path there
    wanted: Sequence[Wanted] = ()  # causes that have to be named
    verdicts: Sequence[str] = ("explained", "partly_explained")  # that are right
    exclude: Sequence[str] = ()  # effects that the diagnosis is not given
    more: bool = False  # whether other causes may be named as well


@dataclass(frozen=True)
class KeyedMark:
    """What became of one case."""

    case: str  # its name
    answer: str  # verdict and causes in words
    named: bool  # whether all that was wanted is named
    alone: bool  # whether nothing else is, or may be
    verdict: bool  # whether the verdict is right
    seconds: float | None  # the duration of the diagnosis; None if it failed


@dataclass(frozen=True)
class KeyedExam(Examiner):
    """Every case once.

    Raises:
        Sim2RealError: a case with other arguments; from `draw`: no folder, or one without a log or
            model.
    """

    data: str | None  # the folder of real logs, which the environment variable SIM2REAL_DATA names
    cases: Mapping[str, Mapping[str, Any]]  # arguments of each case by its name, see `make_case`
    title: ClassVar[str] = "Robots with a published key"

    def __post_init__(self) -> None:
        super().__post_init__()
        _ = self.keyed

    @cached_property
    def keyed(self) -> dict[str, Keyed]:
        """The cases by name."""
        return {name: make_case(name, entry) for name, entry in self.cases.items()}

    def draw(self, seed: int) -> list[Outline]:
        """Return the cases; nothing is drawn, so that any seed gives the same ones."""
        for name, case in self.keyed.items():
            for part in (case.log, case.model):
                check_data(self.data, part, name)
        return [
            Outline(name, "keyed", Path(case.log).parts[0], (), seed)
            for name, case in self.keyed.items()
        ]

    def make(self, outline: Outline, logs: Path, key: Path) -> bool:
        """Write a case's two folders; see `Examiner`."""
        case, data = self.keyed[outline.name], Path(self.data or "")
        logs.mkdir(parents=True, exist_ok=True)
        model = Path(shutil.copy(data / case.model, logs / "model.xml")).resolve()
        log = read_log(data / case.log)
        write_log(logs / "a.csv", replace(log, meta={**log.meta, "model": str(model)}))
        write_task(logs, case.exclude)
        write_text(key / KEY, json.dumps({"name": outline.name}) + "\n")
        return True

    def mark(self, folder: Path, name: str) -> KeyedMark:
        """Compare the answer to a case with what was published."""
        return mark(name, self.keyed[name], read_case(folder, name)[1])

    def summarize(
        self, marks: Sequence[KeyedMark], seed: int, plots: Path
    ) -> dict[str, tuple[str, Table]]:
        """Return the figures and all cases; see `Examiner`."""
        figures = Table(("figure", "cases", "value"))
        for label, hits in (
            ("all that is withheld is named", [one.named for one in marks]),
            ("nothing else is", [one.alone for one in marks]),
            ("verdict as expected", [one.verdict for one in marks]),
        ):
            figures.add(label, len(hits), wilson(hits))
        return {"table": ("Figures", figures), "cases": ("Cases", cases(marks))}


def make_case(name: str, entry: Mapping[str, Any]) -> Keyed:
    """Return a case from its arguments; those of each `wanted` cause are a mapping as well.

    Raises:
        Sim2RealError: other arguments than those of `Keyed` and `Wanted`.
    """
    try:
        wanted = [Wanted(**one) for one in entry.get("wanted", ())]
        return Keyed(**{**entry, "wanted": wanted})
    except TypeError as error:
        raise Sim2RealError(
            f"exam.cases.{name}: {error}; a case has {', '.join(Keyed.__dataclass_fields__)}, each "
            f"cause of `wanted` has {', '.join(Wanted.__dataclass_fields__)}"
        ) from None


def mark(name: str, case: Keyed, report: Mapping[str, Any] | None) -> KeyedMark:
    """Compare an answer, None if the diagnosis failed, with what was published of its case."""
    if report is None:
        return KeyedMark(name, "failed", False, False, False, None)
    causes = report["causes"]
    others = [c for c in causes if not any(one.is_named_by(c) for one in case.wanted)]
    return KeyedMark(
        name,
        words(report),
        all(one.counts_in(causes) for one in case.wanted),
        case.more or not others,
        report["verdict"] in case.verdicts,
        report["seconds"],
    )


def _acts(cause: Mapping[str, Any], episode: int, moment: float) -> bool:
    """Return whether a cause acts near a moment of an episode."""
    if cause.get("seconds") is None or cause["extra"].get("episode") != episode:
        return False
    first, last = cause["seconds"]
    return first - NEAR <= moment <= last + NEAR
