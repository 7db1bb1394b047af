"""The history of an improvement, round by round: improve.json, a table and a picture.

    story = ImprovementHistory(tolerance=0.02, seed=0)
    story.rounds.append(Round(0, "RUN", robot=[0.6, 0.5], simulator=[2.2, 2.1]))
    story.end()                                 # None: there is something to gain
    story.write(out, about)

Returns of a round are of the same starts on the robot and in the simulator that its policy was
trained in, so that their differences are taken start by start.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sim2real.loops.improve.plot import draw
from sim2real.runs.files import write_text
from sim2real.runs.statistics import Interval, bootstrap, mean
from sim2real.runs.tables import Table, format_cell

End = Literal[
    "within_noise",
    "no_gain",
    "rounds",
    "nothing_found",
    "interface",
    "log",
    "stopped",
    "declined",
    "no_robot",
]
WORDS: dict[End, str] = {
    "within_noise": "the return on the robot is within its noise of the simulator's",
    "no_gain": "the last round brought nothing on the robot",
    "rounds": "all rounds are used",
    "nothing_found": "the diagnosis found nothing that the simulator lacks",
    "interface": "the policy's interface is broken, which training cannot fix",
    "log": "the recordings contradict themselves: correct them first",
    "stopped": "the guard stopped the robot",
    "declined": "the operator ended it",
    "no_robot": "the policy is retrained; give port= to run it on the robot that made the logs",
}
GOES_ON = ("stopped", "declined")  # ends after which the same command goes on
SCHEMA = 1
RESULT = "improve.json"
DRAWS = 2000  # resamples of an interval
INTERVALS = 2  # stream of randomness


@dataclass(frozen=True)
class Round:
    """A policy, and what it earned."""

    number: int  # 0 is the policy as given
    policy: str  # its run or checkpoint
    robot: list[float] | None  # its returns on the robot; None where it was not run there
    simulator: list[float]  # in the simulator that it was trained in, from the same starts
    # whether the policy before saw and did there what it was trained on; None: nothing was compared
    contract: str | None = None
    verdict: str | None = None  # of the diagnosis; None in round 0
    causes: Sequence[Mapping[str, Any]] = ()  # what was found, with value, interval and cost
    # periods, overruns and answers of the deployment, see `hardware/link.py`; None where there was
    # none, or no servos
    link: Mapping[str, Any] | None = None


@dataclass
class ImprovementHistory:
    """The rounds so far."""

    tolerance: float  # relative difference below which returns count as equal
    seed: int  # of the intervals' resamples
    rounds: list[Round] = field(default_factory=list)

    def interval(self, values: Sequence[float]) -> Interval:
        """Return the mean of values and its 95 % interval."""
        table = np.array(values, float)[:, None]
        if not np.ptp(table):
            return Interval(*[float(table[0, 0])] * 3)
        rng = np.random.default_rng([self.seed, INTERVALS])
        return bootstrap(table, mean, rng, draws=DRAWS, resample="rows")

    def behind(self, one: Round) -> Interval | None:
        """Return by how much more a policy earns on the robot than in its simulator."""
        return None if one.robot is None else self._difference(one.robot, one.simulator)

    def gained(self, number: int) -> Interval | None:
        """Return by how much more a round's policy earns on the robot than the one before."""
        if number < 1:
            return None
        before, after = self.rounds[number - 1].robot, self.rounds[number].robot
        return None if before is None or after is None else self._difference(after, before)

    def _difference(self, first: Sequence[float], second: Sequence[float]) -> Interval:
        return self.interval(np.subtract(first, second).tolist())

    @property
    def best(self) -> int:
        """The round whose policy earned most on the robot; the last one where none was run."""
        ran = [one for one in self.rounds if one.robot is not None]
        if not ran:
            return self.rounds[-1].number
        return max(ran, key=lambda one: float(np.mean(one.robot))).number  # type: ignore[arg-type]

    def end(self) -> End | None:
        """Return why nothing more is to be done after the last round; None where there is more."""
        last = self.rounds[-1]
        behind, gained = self.behind(last), self.gained(len(self.rounds) - 1)
        nothing = self.tolerance * abs(float(np.mean(last.simulator)))
        if behind is not None and behind.high >= -nothing:
            return "within_noise"
        if gained is not None and gained.value <= nothing:
            return "no_gain"
        return None

    def table(self) -> Table:
        """Return a row for each round."""
        columns = ("round", "found", "in its simulator", "on the robot", "robot − simulator")
        table = Table((*columns, "gained"))
        for number, one in enumerate(self.rounds):
            robot = None if one.robot is None else self.interval(one.robot)
            returns = (self.interval(one.simulator), robot, self.behind(one), self.gained(number))
            table.add(str(one.number), words_of(one.causes) or "–", *returns)
        return table

    def write(self, out: Path, end: End | None, about: Mapping[str, Any], why: str = "") -> None:
        """Write improve.json, improve.md, improve.csv and plots/improve.png.

        Args:
            out: the folder of the loop.
            end: why it ended; None while it goes on.
            about: the robot and the settings.
            why: the guard's words where it stopped the robot.
        """
        best = self.rounds[self.best] if self.rounds else None
        rounds = [
            {**asdict(one), "behind": self.behind(one), "gained": self.gained(number)}
            for number, one in enumerate(self.rounds)
        ]
        facts = {
            "schema": SCHEMA,
            **about,
            "end": end,
            "words": "" if end is None else WORDS[end],
            "why": why,
            "best": None if best is None else best.number,
            "policy": None if best is None else best.policy,
            "rounds": rounds,
        }
        write_text(out / RESULT, json.dumps(facts, indent=1, ensure_ascii=False) + "\n")
        if best is None:
            return
        table, episodes = self.table(), len(self.rounds[-1].simulator)
        table.notes.append(
            f"Returns ({about['unit']}): means of {episodes} episodes that start alike everywhere, "
            "with 95 % bootstrap intervals over them. Round 0 is the policy as given."
        )
        if end is not None:
            table.notes.append(f"It ended because {WORDS[end]}{f' ({why})' if why else ''}.")
            if end in GOES_ON:
                table.notes.append(f"To go on, run the same command with resume={out}.")
            table.notes.append(f"The best policy is that of round {best.number}: {best.policy}.")
        table.write(out / "improve", "The policy's return, round by round")
        draw(self.rounds, self.interval, out / "plots" / "improve.png")


def words_of(causes: Sequence[Mapping[str, Any]]) -> str:
    """Return causes with value, 90 % interval and unit, as a person reads them."""
    return "; ".join(word_of(cause) for cause in causes)


def word_of(cause: Mapping[str, Any]) -> str:
    """Return one cause: its name, value, interval and unit."""
    text = f"{cause['label']} {cause['value']:.3g}"
    if cause["ci"] is not None:
        text += " [{:.3g}, {:.3g}]".format(*cause["ci"])
    return f"{text} {cause['unit']}".rstrip()


def table_of(one: Round, gap: str) -> Table:
    """Return a round's causes, the costliest first: value, share of the gap and cost.

    `gap` is a sentence on the gap that the diagnosis measured.
    """
    table = Table(("cause", "90 % interval", "unit", "gap closed", "return lost"))
    cost = {cause["label"]: cause["cost"] for cause in one.causes}
    order = sorted(one.causes, key=lambda cause: -cost[cause["label"]][0])
    for cause in order:
        ends = cause["ci"] or (cause["value"], cause["value"])
        size = f"{cause['value']:.3g} [{ends[0]:.3g}, {ends[1]:.3g}]"
        price = Interval(*cause["cost"])
        table.add(cause["label"], size, cause["unit"] or "factor", cause["closed"], price)
    robot = "was not run" if one.robot is None else format_cell(float(np.mean(one.robot)))
    table.notes += [
        gap,
        f"Return lost: what each cause costs the policy of round {one.number - 1} (95 %). After "
        f"this round: {format_cell(float(np.mean(one.simulator)))} in its simulator, on the robot "
        f"{robot}.",
    ]
    return table
