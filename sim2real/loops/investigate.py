"""Record, diagnose, design the next recording: until explanations are parted, or time is spent.

    found = investigate(robot, record, limits, seed=0, out=Path("outputs/mine"))
    found.end                   # why it ended: see `WORDS`
    found.rounds[-1].left       # explanations that the recordings so far leave open

Each round adds a recording to all earlier ones and diagnoses them together. What the logs cannot
tell apart then plays against itself in motions of a menu and in drawn ones, each explanation
refitting to what the other would show (`diagnosis.experiments.apart`); the one in which the most
similar of those that can be parted part fastest is recorded next.
"""

import json
import logging
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from hardware.config import Robot
from hardware.log import Log
from sim2real.diagnosis.data.progress import Progress
from sim2real.diagnosis.data.recording import load_model
from sim2real.diagnosis.design import design
from sim2real.diagnosis.diagnose import run_diagnosis
from sim2real.diagnosis.experiments.menu import LENGTHS, Item
from sim2real.diagnosis.experiments.next_experiment import Experiment
from sim2real.diagnosis.outcome import Diagnosis, write
from sim2real.diagnosis.report.text import format_effect, place_of
from sim2real.diagnosis.schema import Report
from sim2real.diagnosis.settings import DEFAULT
from sim2real.runs.errors import Sim2RealError
from sim2real.runs.files import write_text
from sim2real.runs.tables import Table

log_ = logging.getLogger(__name__)
End = Literal[
    "one_left", "not_parted", "log_or_robot", "push_or_robot", "no_gap", "unexplained", "budget"
]
Record = Callable[[Item, Path], Log]
SHORTEST = min(LENGTHS) * DEFAULT.experiment.motion_s  # s, of a designed motion
DESIGN = 1  # stream of randomness: drawn motions
WORDS: dict[End, str] = {
    "one_left": "one explanation is left",
    "not_parted": "no motion of this robot that was looked at can part what is left",
    "log_or_robot": "several explanations are left, some with a mistake in the log, which no "
    "motion can show: check how the log is written",
    "push_or_robot": "a push explains a moment as well as an effect does: record the same motion "
    "again, with nobody near the robot",
    "no_gap": "the model follows the robot: there is nothing to explain",
    "unexplained": "nothing in the vocabulary explains the gap: there is nothing to part",
    "budget": "the budget is spent, and several explanations are left",
}


@dataclass(frozen=True)
class SearchBudget:
    """The robot's time budget, and the effort of the search for motions."""

    budget: float  # s of robot time in all
    draws: int = 48  # motions that are drawn for each design, besides the menu's
    exact: int = 3  # number of the best motions whose refits are simulated until they settle


@dataclass(frozen=True)
class Round:
    """One recording and what all of them then said."""

    name: str  # the motion, as a person says it
    motions: tuple[str, ...]  # kinds of `hardware.excite`
    seconds: float  # of the motion
    size: float  # part of the way to the nearer limit
    seed: int  # of its phases and poses
    # noise floors that it was to part the explanations by, of those that some motion parts; None
    # for the first
    promised: float | None
    verdict: str  # of the diagnosis of all recordings so far
    causes: tuple[str, ...]  # labels of what it named
    # labels of the explanations that stay open; () where there is one, or none
    left: tuple[str, ...]


@dataclass(frozen=True)
class Investigation:
    """The result of an investigation."""

    end: End  # why it ended, see `WORDS`
    rounds: tuple[Round, ...]  # one a recording
    seconds: float  # robot time that was spent
    # noise floors between any two that are left, in any motion that was looked at, where the end
    # is `not_parted`; else None
    apart: float | None
    looked_at: int  # motions that were looked at for it
    report: Report  # the last diagnosis

    def write(self, out: Path) -> None:
        """Write investigate.json and the table of rounds atomically."""
        tree = {"schema": 1, **asdict(replace(self, report=None))}  # type: ignore[arg-type]
        del tree["report"]
        write_text(out / "investigate.json", json.dumps(tree, indent=1, allow_nan=False) + "\n")
        table = Table(("motion", "s", "promised (floors)", "verdict", "causes", "left open"))
        for one in self.rounds:
            left = ", ".join(one.left) or "–"
            causes = ", ".join(one.causes) or "–"
            table.add(one.name, one.seconds, one.promised, one.verdict, causes, left)
        table.notes.append(f"{self.seconds:g} s of robot time; {WORDS[self.end]}.")
        table.write(out / "investigate", "What each recording showed")


def investigate(
    robot: Robot,
    record: Record,
    limits: SearchBudget,
    first: Item,
    *,
    seed: int,
    out: Path,
    logs: Sequence[Log] = (),
    progress: Progress | None = None,
) -> Investigation:
    """Record and diagnose until one explanation is left, nothing parts them, or time is spent.

    Args:
        robot: its model is the nominal one.
        record: drives it along a motion, and writes the log to a path.
        limits: see `SearchBudget`.
        first: the motion of the first recording, where there are no logs.
        seed: all randomness follows from it.
        out: the run's folder; gets recordings/NN.csv, all that `diagnose` writes (of the last
            round), investigate.json and investigate.md, each as soon as it is there.
        logs: earlier recordings of this robot, to start from.
        progress: called with what is being tried and the share of that diagnosis.

    Raises:
        Sim2RealError: a budget below one recording; what a diagnosis refuses.
        HardwareError: what a recording refuses; the rounds before are written.
    """
    least = SHORTEST if logs else first.seconds
    if not limits.budget >= least:
        raise Sim2RealError(
            f"budget={limits.budget:g} s is below one recording of {least:g} s; raise budget or "
            "lower seconds"
        )
    known, rounds, spent = list(logs), [], 0.0
    item, promised = (None, None) if known else (first, None)
    while True:
        if item is not None:
            known.append(record(item, out / "recordings" / f"{len(rounds):02d}.csv"))
            spent += item.seconds
        found = run_diagnosis(
            known, None, None, (), seed, progress, on_verdict=lambda d: write(d, out)
        )
        write(found, out)
        rounds.append(_round(item, promised, found))
        plan = None if found.equivalents else "over"
        left = limits.budget - spent
        if plan is None and left >= SHORTEST:
            plan = design(
                found,
                known,
                load_model(known[0], None),
                rng=np.random.default_rng([seed, DESIGN, len(rounds)]),
                robot=robot,
                draws=limits.draws,
                exact=limits.exact,
                by_hand=False,
                longest=left,
            )
        end = _end(found.report, plan)
        chosen = plan if isinstance(plan, Experiment) else None
        apart = chosen.most if chosen and end == "not_parted" else None
        looked_at = len(chosen.ranking) if chosen else 0
        result = Investigation(
            end or "budget", tuple(rounds), spent, apart, looked_at, found.report
        )
        result.write(out)
        log_.info("%s", _line(result, chosen if end is None else None))
        if end is not None or chosen is None:
            return result
        item, promised = chosen.item, chosen.separation


def _end(report: Report, plan: Experiment | str | None) -> End | None:
    """Return why an investigation ends; None where it goes on."""
    if isinstance(plan, Experiment):
        return None if plan.most >= DEFAULT.experiment.apart_min else "not_parted"
    if plan is None:
        return "budget"
    if report.verdict == "no_gap":
        return "no_gap"
    if alike := [cause for cause in report.causes if cause.equivalent]:  # no motion parts these
        return "push_or_robot" if alike[0].effect == "push" else "log_or_robot"
    return "one_left" if report.causes else "unexplained"


def _round(item: Item | None, promised: float | None, found: Diagnosis) -> Round:
    motion = item or Item("earlier recordings", (), 0.0)
    causes = tuple(format_effect(*place_of(cause)) for cause in found.report.causes)
    return Round(
        motion.name,
        motion.motions,
        motion.seconds,
        motion.size,
        motion.seed,
        promised,
        found.report.verdict,
        causes,
        tuple(member.label for member in found.equivalents),
    )


def _line(result: Investigation, design: Experiment | None) -> str:
    """Return a round in a sentence."""
    last = result.rounds[-1]
    text = f"round {len(result.rounds)}, {result.seconds:g} s of robot time: {last.verdict}"
    if design is not None:
        return f"{text}; {len(last.left)} explanations are left; next: {design.item.name}"
    return f"{text}; {WORDS[result.end]}"
